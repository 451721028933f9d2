"""What an FMU was packed from, so that files of two FMUs are not mixed without a word.

pythonfmu's library does not hand on the guid that the master gives. What can be compared is compared: the guid in the
model description beside the resources, and the modal file, with those that the archive was packed with.
"""

from dataclasses import dataclass
from io import BytesIO
from xml.etree.ElementTree import ParseError, iterparse

from .errors import ContentsError

DESCRIPTION = "modelDescription.xml"
_ADVICE = "files of two FMUs are mixed; unpack the FMU again, or build it again"


@dataclass(frozen=True, slots=True)
class Contents:
    """Guid and modal file of an archive.

    Attributes
    ----------
    guid : str
        As in the model description.
    modal_file : str
        Of its bytes, as of `state_block.identity`, in hexadecimal digits.
    """

    guid: str
    modal_file: str

    def check(self, modal_file: bytes, guid: str | None) -> None:
        """Compare them with what was found.

        Parameters
        ----------
        modal_file : bytes
            As of `state_block.identity`.
        guid : str or None
            Of the model description; None where there is none to be found.

        Raises
        ------
        ContentsError
            One is of another FMU.
        """
        if guid is not None and guid != self.guid:
            raise ContentsError(
                f"{DESCRIPTION} has the guid {guid}, and the code and data beside it are of {self.guid}: {_ADVICE}"
            )
        if modal_file.hex() != self.modal_file:
            raise ContentsError(
                f"the modal file has the checksum {modal_file.hex()}, and the FMU {self.guid} was packed with "
                f"{self.modal_file}: {_ADVICE}"
            )


def described_guid(xml: bytes) -> str:
    """Guid in a model description.

    Parameters
    ----------
    xml : bytes

    Returns
    -------
    str

    Raises
    ------
    ContentsError
        No XML.
    """
    try:
        # The root comes first: of a body with many variables the rest need not be read.
        _, root = next(iterparse(BytesIO(xml), events=("start",)))
    except (ParseError, StopIteration) as error:
        raise ContentsError(f"{DESCRIPTION} cannot be read ({error}): unpack the FMU again") from error
    return str(root.get("guid", ""))
