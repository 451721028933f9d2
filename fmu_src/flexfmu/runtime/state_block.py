"""The FMU's state as one sealed block of bytes: what body it belongs to, a checksum, then the numbers.

A master may keep the block on disk and give it back later, to another instance, damaged, or to another FMU: nothing but
what was taken from an FMU with the same modal file is let through.
"""

import hashlib

from .errors import OptionError

_MARK = b"flexfmu state 1\0"
_DIGEST = 16


def identity(modal_file: bytes) -> bytes:
    """Short hash of a modal file, by which its states are known."""
    return hashlib.blake2b(modal_file, digest_size=_DIGEST).digest()


def seal(numbers: bytes, owner: bytes) -> bytes:
    """Block of some numbers.

    Parameters
    ----------
    numbers : bytes
    owner : bytes
        As of `identity`.

    Returns
    -------
    bytes
    """
    return _MARK + owner + hashlib.blake2b(numbers, digest_size=_DIGEST).digest() + numbers


def unseal(block: bytes, owner: bytes, size: int) -> bytes:
    """Numbers of a block.

    Parameters
    ----------
    block : bytes
    owner : bytes
        As of `identity`.
    size : int
        Bytes that the numbers take.

    Returns
    -------
    bytes

    Raises
    ------
    OptionError
        The block is no state, is of another FMU, or is damaged.
    """
    head = len(_MARK) + 2 * _DIGEST
    if len(block) < head or not block.startswith(_MARK):
        raise OptionError(f"FMU state of {len(block)} bytes is none of flexfmu's")
    if block[len(_MARK) : len(_MARK) + _DIGEST] != owner:
        raise OptionError("FMU state is of another FMU: states go between instances of the same FMU only")
    numbers = block[head:]
    if len(numbers) != size or seal(numbers, owner) != block:
        raise OptionError(f"FMU state is damaged: {len(block)} bytes, expected {head + size} with their checksum")
    return numbers
