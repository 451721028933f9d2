"""Keywords of Abaqus and CalculiX decks: which are honoured, which are left unused, and which cannot be."""

# Keywords that are honoured and their parameters; others might change what the card means.
HONOURED: dict[str, tuple[str, ...]] = {
    "NODE": ("NSET", "ID"),
    "ELEMENT": ("TYPE", "ELSET", "ID"),
    "NSET": ("NSET", "GENERATE", "ELSET", "UNSORTED", "INTERNAL", "INSTANCE"),
    "ELSET": ("ELSET", "GENERATE", "UNSORTED", "INTERNAL", "INSTANCE"),
    "SURFACE": ("NAME", "TYPE", "INTERNAL", "INSTANCE"),
    "MATERIAL": ("NAME", "ID", "SRATEFACTOR"),
    "ELASTIC": ("TYPE", "MODULI"),
    "DENSITY": (),
    "SOLID SECTION": ("ELSET", "MATERIAL", "ORIENTATION", "CONTROLS", "REFNODE"),
    "ORIENTATION": ("NAME", "SYSTEM", "DEFINITION"),
    "BOUNDARY": ("AMPLITUDE", "OP", "TYPE", "FIXED"),
}
PARAMETERS = {keyword.replace(" ", ""): names for keyword, names in HONOURED.items()}

# Say nothing of the body: passed over in silence.
HARMLESS = frozenset(
    """
    HEADING PREPRINT NODEPRINT NODEFILE NODEOUTPUT ELPRINT ELFILE ELEMENTOUTPUT OUTPUT CONTACTOUTPUT ENERGYOUTPUT
    ENERGYPRINT SECTIONPRINT FILEFORMAT MONITOR CONTACTFILE CONTACTPRINT FACEPRINT PRINT RESTART PARAMETER USERNODE
    NODALTHICKNESS VIEWFACTOROUTPUT CAEASSEMBLY DISTRIBUTIONTABLE
    """.split()
)

# Do not bear on stiffness or mass at rest: passed over with a note.
UNUSED = frozenset(
    """
    AMPLITUDE CONDUCTIVITY DAMPING EXPANSION PHYSICALCONSTANTS SPECIFICHEAT TIMEPOINTS LATENTHEAT INELASTICHEATFRACTION
    INITIALCONDITIONS BASEMOTION CONTROLS SECTIONCONTROLS PLASTIC CYCLICHARDENING CREEP VISCOELASTIC RATEDEPENDENT
    DAMAGEINITIATION DAMAGEEVOLUTION DAMAGESTABILIZATION DEFORMATIONPLASTICITY HYPERELASTIC HYPERFOAM DRUCKERPRAGER
    MOHRCOULOMB POTENTIAL COMBINEDTESTDATA UNIAXIALTESTDATA BIAXIALTESTDATA PLANARTESTDATA VOLUMETRICTESTDATA
    SHEARTESTDATA USERMATERIAL DEPVAR USERDEFINEDFIELD FIELD TEMPERATURE ELECTRICALCONDUCTIVITY MAGNETICPERMEABILITY
    FLUIDCONSTANTS SPECIFICGASCONSTANT VALUESATINFINITY FILM RADIATE DFLUX CFLUX SINKTEMPERATURE
    SURFACEINTERACTION SURFACEBEHAVIOR FRICTION CONTACT CONTACTINCLUSIONS CONTACTEXCLUSIONS CONTACTPAIR
    CONTACTPROPERTYASSIGNMENT CONTACTINITIALIZATIONASSIGNMENT CONTACTINITIALIZATIONDATA CONTACTFORMULATION
    SURFACEPROPERTYASSIGNMENT CONTACTDAMPING CONTACTCONTROLS CONTACTSTABILIZATION CONTACTINTERFERENCE CLEARANCE
    GAPCONDUCTANCE GAPHEATGENERATION GAPRADIATION CHANGEFRICTION SURFACESMOOTHING PRETENSIONSECTION
    SUBMODEL CYCLICSYMMETRYMODEL FILTER INTEGRATEDOUTPUTSECTION MODALDAMPING
    DESIGNVARIABLES OBJECTIVE CONSTRAINT SENSITIVITY
    """.split()
)
# Those of them that may do to a body at rest what flexfmu does not know.
_WHY = {
    "INITIALCONDITIONS": "the body begins without stress",
    "PLASTIC": "the body is elastic",
    "HYPERELASTIC": "the body is linearly elastic: give its constants in [material]",
    "HYPERFOAM": "the body is linearly elastic: give its constants in [material]",
    "USERMATERIAL": "the body is linearly elastic: give its constants in [material]",
    "CONTACTPAIR": "the surfaces do not touch each other",
    "CONTACT": "surfaces do not touch each other",
    "PRETENSIONSECTION": "the body begins without stress",
    "SUBMODEL": "nothing drives its boundary",
    "CYCLICSYMMETRYMODEL": "the body is what the mesh shows, one sector",
}
# Give stiffness to faces, edges and points: sections of elements that are no solids.
SECTIONS = frozenset(
    """
    SHELLSECTION SHELLGENERALSECTION MEMBRANESECTION BEAMSECTION BEAMGENERALSECTION FRAMESECTION RIGIDSECTION
    """.split()
)


def unused(keyword: str, key: str) -> str:
    """Return the note on a card that is left unused.

    Parameters
    ----------
    keyword, key : str
        As spelt, and without blanks.

    Returns
    -------
    str
    """
    why = _WHY.get(key)
    return f"*{keyword} is left unused{f': {why}' if why else ''}"
