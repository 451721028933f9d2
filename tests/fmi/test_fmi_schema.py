"""modelDescription.xml and archive of every kind of FMU against FMI 2.0: the XML schema, and the rules beside it.

Sections are those of the FMI Specification 2.0.4. Expectations are the standard's, not the writer's: nothing here reads
the table of variables that the description is made from.
"""

import re
import zipfile
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from uuid import UUID
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from bodies import beam_body, random_body
from driven import RUNTIMES
from flexfmu.build.tables import InputTable, OutputTable, StressTable
from flexfmu.core.building import PLATFORMS as BINARIES, this_platform
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import Masses, StressSet
from flexfmu.reduction.options import Basis
from references import BEAM

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"

# Section 2.2.7, the tables after "causality": which combinations of causality and variability there are, and which
# values of initial each allows, the default first.
COMBINATIONS = {
    ("parameter", "fixed"): ["exact"],
    ("parameter", "tunable"): ["exact"],
    ("calculatedParameter", "fixed"): ["calculated", "approx"],
    ("calculatedParameter", "tunable"): ["calculated", "approx"],
    ("input", "discrete"): [None],
    ("input", "continuous"): [None],
    ("output", "constant"): ["exact"],
    ("output", "discrete"): ["calculated", "exact", "approx"],
    ("output", "continuous"): ["calculated", "exact", "approx"],
    ("local", "constant"): ["exact"],
    ("local", "fixed"): ["calculated", "approx"],
    ("local", "tunable"): ["calculated", "approx"],
    ("local", "discrete"): ["calculated", "exact", "approx"],
    ("local", "continuous"): ["calculated", "exact", "approx"],
    ("independent", "continuous"): [None],
}
# Section 2.2.9, structured naming.
_B_NAME = r"(?:[_A-Za-z][_A-Za-z0-9]*|'(?:[^'\\\x00-\x1f]|\\['\"?\\abfnrtv])+')"
_INDICES = r"(?:\[[0-9]+(?:,[0-9]+)*\])?"
STRUCTURED = re.compile(rf"(?:{_B_NAME}{_INDICES}(?:\.{_B_NAME}{_INDICES})*)")
LOG_CATEGORIES = {
    "logEvents",
    "logSingularLinearSystems",
    "logNonlinearSystems",
    "logDynamicStateSelection",
    "logStatusWarning",
    "logStatusDiscard",
    "logStatusError",
    "logStatusFatal",
    "logStatusPending",
    "logAll",
}
C_KEYWORDS = re.compile(
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|int|long|register|return|"
    "short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|volatile|while"
)
# A core that was compiled here; pythonfmu's library comes for the same platforms as the core.
PLATFORMS_HELD = {this_platform(): BINARIES[this_platform()].ending}
KINDS = [
    "without frames",
    "one frame",
    "tree",
    "velocities",
    "acceleration",
    "stress",
    "geometric stiffness",
    "everything",
    "normal modes",
    "craig bampton",
    "free",
]


def synthetic(kind):
    """A small body of a kind."""
    if kind == "without frames":
        return beam_body(0, modes=2)
    if kind == "one frame":
        return beam_body(1, modes=2)
    body = random_body(modes=4, velocity_outputs=kind in ("velocities", "everything"))
    rng = np.random.default_rng(4)
    changes = {}
    if kind in ("acceleration", "everything"):
        points, shapes = rng.uniform(-1.0, 1.0, (2, 3)), rng.standard_normal((2, 3, 4))
        changes["masses"] = Masses(np.array([1.0, 2.0]), points, shapes, np.array([0, 1]))
    if kind in ("stress", "everything"):
        stresses = [
            (name, rng.uniform(-1.0, 1.0, (2, 3)), rng.standard_normal((2, 6, 4))) for name in ("root", "notch")
        ]
        changes["stress_sets"] = tuple(StressSet(*part) for part in stresses)
    if kind == "geometric stiffness":
        changes["stiffness_by_load"] = np.zeros((18, 4, 4))
    if kind == "everything":
        changes["compliance_interfaces"] = ("port_0", "port_2")
    if kind in ("geometric stiffness", "everything"):
        changes["stiffness_by_mode"] = np.zeros((4, 4, 4))
        changes["method"] = Method.STIFFNESS_BY_MODE
    return replace(body, **changes)


@pytest.fixture(scope="module")
def make(bodies):
    """A body of a kind, synthetic or out of a mesh."""

    def build(kind):
        reduction = bodies.config(BEAM).reduction.model_copy(update={"modes": 2})
        bampton = reduction.model_copy(update={"basis": Basis.CRAIG_BAMPTON})
        more = {"input": InputTable(acceleration=True), "output": OutputTable(velocities=True, surface=True)}
        if kind == "normal modes":
            return bodies.beam(reduction=reduction, frames=2).model
        if kind == "craig bampton":
            stress = [StressTable(name="everywhere", elements="EALL")]
            return bodies.beam(reduction=bampton, frames=2, stress=stress, **more).model
        if kind == "free":
            return bodies.beam(free=True, support=[], reduction=bampton, frames=2, **more).model
        return synthetic(kind)

    return build


@pytest.fixture(scope="module", params=RUNTIMES, ids=lambda runtime: runtime.value)
def runtime(request):
    """Each export."""
    return request.param


@pytest.fixture(scope="module", params=KINDS)
def fmu(request, make, runtime, tmp_path_factory):
    """Path of an FMU of each kind and export."""
    path = tmp_path_factory.mktemp("kinds") / "body.fmu"
    package_fmu(make(request.param), path, runtime)
    return path


@pytest.fixture(scope="module")
def text(fmu):
    with zipfile.ZipFile(fmu) as archive:
        return archive.read("modelDescription.xml")


@pytest.fixture(scope="module")
def root(text):
    return ElementTree.fromstring(text)


@pytest.fixture(scope="module")
def variables(root):
    """Scalar variables in their order."""
    return list(root.find("ModelVariables"))


def indices(root, where):
    """Indices of the unknowns in a part of the model structure."""
    return [int(unknown.get("index")) for unknown in root.findall(f"ModelStructure/{where}/Unknown")]


def default(variable, name):
    """An attribute of a variable, with the standard's default."""
    return variable.get(name, {"causality": "local", "variability": "continuous"}.get(name))


# By the tools.


@pytest.mark.slow
def test_fmpys_validator_finds_no_problem(fmu):
    assert validate_fmu(str(fmu)) == []


def test_the_description_is_valid_by_the_xml_schema_of_fmi_2(text):
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    schema.assertValid(etree.fromstring(text))


def test_the_description_is_utf8_without_namespaces_or_document_types(text):
    # Section 2.2: UTF-8. Readers of FMUs do not resolve entities.
    assert text.startswith(b'<?xml version="1.0" encoding="UTF-8"?>')
    text.decode("utf-8")
    assert b"<!DOCTYPE" not in text
    assert b"xmlns" not in text


# Section 2.2.1, the root.


def test_the_root_says_which_model_and_who_made_it(root):
    assert root.tag == "fmiModelDescription"
    assert root.get("fmiVersion") == "2.0"
    assert root.get("modelName")
    assert root.get("variableNamingConvention") == "structured"
    # A fingerprint: by custom a UUID in braces.
    assert str(UUID(root.get("guid").strip("{}"))) == root.get("guid").strip("{}")
    assert root.get("numberOfEventIndicators", "0") == "0"
    made = root.get("generationDateAndTime")
    if made is not None:
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", made)
        datetime.fromisoformat(made)


def test_the_experiment_is_possible(root):
    experiment = root.find("DefaultExperiment")
    start, stop, step = (float(experiment.get(name)) for name in ("startTime", "stopTime", "stepSize"))
    assert start < stop
    assert 0.0 < step < stop - start
    tolerance = experiment.get("tolerance")
    assert tolerance is None or float(tolerance) > 0.0


def test_log_categories_are_standardised_and_different(root):
    names = [category.get("name") for category in root.find("LogCategories")]
    assert len(set(names)) == len(names)
    assert set(names) <= LOG_CATEGORIES


# Section 4.3.1, co-simulation.


def test_the_capabilities_are_those_that_are_there(root, runtime):
    interface = root.find("CoSimulation")
    assert root.find("ModelExchange") is None
    flags = {
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    assert {name: interface.get(name) for name in flags} == flags
    # What pythonfmu's library does not hand on is not promised.
    handed_on = "true" if runtime is Runtime.NATIVE else "false"
    for name in ("canInterpolateInputs", "providesDirectionalDerivative"):
        assert interface.get(name, "false") == handed_on
    assert interface.get("canRunAsynchronuously", "false") == "false"
    assert interface.get("maxOutputDerivativeOrder", "0") == "0"
    # Whoever can serialise states can get and set them.
    assert interface.get("canGetAndSetFMUstate") == "true" or interface.get("canSerializeFMUstate") != "true"


def test_the_model_identifier_is_a_name_in_c_and_that_of_the_binaries(fmu, root):
    identifier = root.find("CoSimulation").get("modelIdentifier")
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier)
    assert not C_KEYWORDS.fullmatch(identifier)
    with zipfile.ZipFile(fmu) as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/")}
    assert binaries == {f"binaries/{platform}/{identifier}{ending}" for platform, ending in PLATFORMS_HELD.items()}


# Section 2.2.2 and 2.2.3, units.


def test_units_are_defined_once_and_used(root, variables):
    units = root.findall("UnitDefinitions/Unit")
    names = [unit.get("name") for unit in units]
    assert len(set(names)) == len(names)
    used = {v[0].get("unit") for v in variables if v[0].get("unit")}
    assert used == set(names)
    for unit in units:
        base = unit.find("BaseUnit")
        assert base is not None, unit.get("name")
        exponents = {key: int(value) for key, value in base.attrib.items() if key not in ("factor", "offset")}
        assert set(exponents) <= {"kg", "m", "s", "A", "K", "mol", "cd", "rad"}
        assert any(exponents.values())


def test_display_units_belong_to_their_unit_and_convert(root, variables):
    shown = {
        (unit.get("name"), display.get("name")): float(display.get("factor", "1"))
        for unit in root.findall("UnitDefinitions/Unit")
        for display in unit.findall("DisplayUnit")
    }
    for variable in variables:
        if (name := variable[0].get("displayUnit")) is not None:
            assert (variable[0].get("unit"), name) in shown, variable.get("name")
    # display value = factor · value: a right angle.
    for (unit, _), factor in shown.items():
        assert unit in ("rad", "rad/s")
        assert factor * np.pi / 2.0 == pytest.approx(90.0, rel=1e-15)


# Section 2.2.7, variables.


def test_names_differ_and_follow_the_structured_naming_convention(variables):
    names = [variable.get("name") for variable in variables]
    assert len(set(names)) == len(names)
    # Some tools tell no letters' case apart.
    assert len({name.lower() for name in names}) == len(names)
    assert [name for name in names if not STRUCTURED.fullmatch(name)] == []
    # A name that stands for a quantity cannot also be the group of others.
    groups = {".".join(name.split(".")[:k]) for name in names for k in range(1, name.count(".") + 1)}
    assert not groups & set(names) - {"initialization"}
    assert "initialization" not in groups


def test_value_references_differ_within_a_type_and_fit_in_32_bits(variables):
    references = [(variable[0].tag, int(variable.get("valueReference"))) for variable in variables]
    assert len(set(references)) == len(references), "aliases are not in use"
    assert all(0 <= reference < 2**31 for _, reference in references)


def test_causality_variability_and_initial_go_together(variables):
    for variable in variables:
        pair = default(variable, "causality"), default(variable, "variability")
        assert pair in COMBINATIONS, variable.get("name")
        initial = variable.get("initial")
        assert initial in (*COMBINATIONS[pair], None), variable.get("name")
        # Only reals can be continuous.
        assert pair[1] != "continuous" or variable[0].tag == "Real", variable.get("name")
        assert pair[0] != "independent", "there is no independent variable in the FMUs"


def test_start_values_are_there_exactly_where_they_must_be(variables):
    for variable in variables:
        causality, variability = default(variable, "causality"), default(variable, "variability")
        initial = variable.get("initial", COMBINATIONS[causality, variability][0])
        start, name = variable[0].get("start"), variable.get("name")
        must = causality in ("input", "parameter") or variability == "constant" or initial in ("exact", "approx")
        assert (start is not None) == must, name
        if variable[0].tag == "Real" and start is not None:
            low, high = (float(variable[0].get(key, limit)) for key, limit in (("min", "-inf"), ("max", "inf")))
            assert np.isfinite(float(start)), name
            assert low <= float(start) <= high, name
        if variable[0].tag == "Boolean" and start is not None:
            assert start in ("true", "false"), name


def test_variables_are_described_once_and_without_types_or_derivatives(root, variables):
    assert root.find("TypeDefinitions") is None
    for variable in variables:
        value = variable[0]
        assert len(variable) == 1
        assert variable.get("description")
        assert value.get("declaredType") is None
        assert value.get("derivative") is None
        assert value.get("reinit", "false") == "false"
        assert value.tag in ("Real", "Integer", "Boolean", "String")
        assert variable.get("canHandleMultipleSetPerTimeInstant") is None, "for model exchange alone"


# Section 2.2.8, structure.


def test_outputs_are_listed_completely_and_in_order(root, variables):
    expected = [index for index, v in enumerate(variables, start=1) if v.get("causality") == "output"]
    assert expected
    assert indices(root, "Outputs") == expected
    assert indices(root, "Derivatives") == []


def test_initial_unknowns_are_listed_completely_and_in_order(root, variables):
    expected = []
    for index, variable in enumerate(variables, start=1):
        causality, variability = default(variable, "causality"), default(variable, "variability")
        initial = variable.get("initial", COMBINATIONS[causality, variability][0])
        if (causality == "output" and initial in ("approx", "calculated")) or causality == "calculatedParameter":
            expected.append(index)
    assert indices(root, "InitialUnknowns") == expected


def test_dependencies_are_indices_of_knowns_in_order(root, variables):
    for part in ("Outputs", "InitialUnknowns"):
        for unknown in root.findall(f"ModelStructure/{part}/Unknown"):
            if (found := unknown.get("dependencies")) is None:
                assert unknown.get("dependenciesKind") is None
                continue
            known = [int(index) for index in found.split()]
            assert known == sorted(set(known))
            for index in known:
                variable = variables[index - 1]
                exact = variable.get("initial") == "exact" and part == "InitialUnknowns"
                assert variable.get("causality") == "input" or exact, (unknown.get("index"), index)
            kinds = (unknown.get("dependenciesKind") or "").split()
            assert len(kinds) in (0, len(known))


# Section 2.3, the archive.


def test_the_archive_holds_each_file_once_under_a_plain_relative_name(fmu):
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
        assert archive.testzip() is None
    assert len(set(names)) == len(names)
    # Windows tells no letters' case apart.
    assert len({name.lower() for name in names}) == len(names)
    for name in names:
        assert name.isascii(), name
        assert name.isprintable(), name
        assert not name.startswith(("/", "\\")), name
        assert "\\" not in name, name
        assert ":" not in name, name
        assert not {"", ".", ".."} & set(name.rstrip("/").split("/")), name
        # Unpacked below a folder of some length, Windows' limit of 260 is far.
        assert len(name) < 120, name


def test_the_description_is_at_the_top_and_everything_else_where_it_belongs(fmu):
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
    assert "modelDescription.xml" in names
    tops = {name.split("/")[0] for name in names}
    allowed = {"modelDescription.xml", "binaries", "resources", "documentation", "sources", "licenses", "model.png"}
    assert tops <= allowed


def test_the_archive_is_stored_or_deflated_and_not_encrypted(fmu):
    # Section 2.3: no other method, since not every reader knows one.
    with zipfile.ZipFile(fmu) as archive:
        for entry in archive.infolist():
            assert entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED), entry.filename
            assert entry.extract_version <= 20, entry.filename
            assert not entry.flag_bits & 0x1, entry.filename
            # Readable for all once unpacked, and no link.
            assert entry.external_attr >> 16 in (0o644, 0o755, 0o100644, 0o100755), entry.filename
    assert fmu.read_bytes()[:4] == b"PK\x03\x04", "something stands before the archive"
