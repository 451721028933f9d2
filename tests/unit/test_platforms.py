"""The core on other platforms: what its libraries need, that they run, and what is said where there is none."""

import ctypes
import os
import runpy
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

import flexfmu.core.library as library
from binary_files import ARM, X86, libraries
from bodies import beam_body
from flexfmu.commands.cli import app
from flexfmu.core import binaries
from flexfmu.core.binaries import core_binaries, web_core
from flexfmu.core.building import (
    FOLDER,
    PLATFORMS,
    WEB,
    WEB_CORE,
    compile_core,
    fat_file,
    source_hash,
    sources,
    system_compiler,
    this_platform,
    zig_compiler,
)
from flexfmu.files.basics import OptionError, PackagingError
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.runtime import Runtime

ROOT = Path(__file__).parents[2]
MASTER = ROOT / "tests" / "native_master" / "master.c"
CLAMPED = ROOT / "demo" / "clamped_beam" / "body.toml"
ZIG = zig_compiler()
# What made web.wasm.
PAGES_BY = "0.17.1"
needs_zig = pytest.mark.skipif(ZIG is None, reason='no compiler for other platforms: pip install ".[platforms]"')
needs_cc = pytest.mark.skipif(system_compiler() is None, reason="no C compiler")
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")

# Machines of each file, and the only libraries that it may need.
EXPECTED = {
    "linux64": ([X86], ("libc.so.6", "libm.so.6")),
    "aarch64-linux": ([ARM], ("libc.so.6", "libm.so.6", "ld-linux-aarch64.so.1")),
    "win64": ([X86], ("kernel32.dll", "msvcrt.dll", "ucrtbase.dll", "api-ms-win-crt-")),
    "darwin64": ([X86, ARM], ("/usr/lib/libSystem.B.dylib",)),
}
LOADS = {"tip.force.x": -2e3, "tip.force.y": 4e3, "tip.moment.z": 300.0}
OUTPUTS = [f"tip.{kind}.{axis}" for kind in ("displacement", "rotation") for axis in "xyz"]
COUNT = 200


@pytest.fixture(scope="module")
def cores():
    """The core of every platform."""
    return core_binaries(["all"])


@pytest.fixture
def nothing_kept(monkeypatch, tmp_path):
    """Neither cores that came with the installation nor any of an earlier build."""
    monkeypatch.setenv("FLEXFMU_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(binaries, "SHIPPED", tmp_path / "none")


class Titles(Reporter):
    """Keeps what it is told."""

    def __init__(self):
        self.titles, self.warnings = [], []

    def stage(self, title):
        self.titles.append(title)
        return super().stage(title)

    def warning(self, text):
        self.warnings.append(text)


# What the files need.


def check_library(name, data):
    machines, allowed = EXPECTED[name]
    found = libraries(data)
    assert [one.machine for one in found] == machines
    for one in found:
        assert one.needed
        assert all(needed.startswith(allowed) for needed in one.needed), one.needed
        assert {"fmi2Instantiate", "fmi2DoStep", "fmi2GetDirectionalDerivative", "fmi2FlexfmuCall"} <= one.offered
        # Nothing else meets names of the master's, but what a compiler adds.
        assert [name for name in one.offered if not name.startswith(("fmi2", "fmi3", "_"))] == []
    return found


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize("name", PLATFORMS)
def test_a_core_needs_only_the_c_library_of_its_platform(cores, name):
    for one in check_library(name, cores[f"{name}{PLATFORMS[name].ending}"]):
        if name.endswith(("linux", "linux64")):
            versions = [tuple(map(int, v.removeprefix("GLIBC_").split("."))) for v in one.versions]
            assert versions
            assert max(versions) <= (2, 17)
        elif name == "darwin64":
            assert one.versions == {"11.0"}
            # Processors of the kind run nothing unsigned.
            assert one.signed or one.machine == X86


@pytest.mark.skipif(this_platform() not in EXPECTED, reason="another platform")
def test_the_core_compiled_here_needs_only_the_c_library_and_offers_fmi():
    data = library.library_path().read_bytes()
    if not data.startswith(b"\xca\xfe\xba\xbe") and this_platform() == "darwin64":
        pytest.skip("compiled for this processor alone")
    check_library(this_platform(), data)


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize("name", PLATFORMS)
def test_the_same_sources_give_the_same_bytes(cores, name, tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    path = folder / f"another_name{PLATFORMS[name].ending}"
    compile_core(path, ZIG, PLATFORMS[name].targets)
    assert path.read_bytes() == cores[f"{name}{PLATFORMS[name].ending}"]
    assert list(folder.iterdir()) == [path]


def test_files_of_macos_begin_each_processor_on_a_page_of_its_own():
    def head(processor):
        return np.array([0xFEEDFACF, processor, 3, 6, 0, 0, 0, 0], dtype="<u4").tobytes() + b"x" * 20001

    found = libraries(fat_file([head(0x01000007), head(0x0100000C)]))
    assert [one.machine for one in found] == [X86, ARM]


# That they run.


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    """FMU with the cores of all platforms, unpacked in a folder with an umlaut."""
    folder = tmp_path_factory.mktemp("fmu") / "Träger #1"
    package_fmu(beam_body(3), folder.with_name("beam.fmu"), platforms=["all"])
    with zipfile.ZipFile(folder.with_name("beam.fmu")) as archive:
        archive.extractall(folder)
    return folder


def run_words(folder, core, address):
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    reference = {v.get("name"): v.get("valueReference") for v in root.find("ModelVariables")}
    loads = [f"r:{reference[name]}={value}" for name, value in LOADS.items()]
    method = [f"s:{reference['method']}={beam_method(root)}"]
    shown = [f"o:{reference[name]}" for name in OUTPUTS]
    return [core, address, root.get("guid"), "1e-3", str(COUNT), *method, *loads, *shown]


def beam_method(root):
    return next(v.find("String").get("start") for v in root.find("ModelVariables") if v.get("name") == "method")


def run_master(command, **environment):
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, check=False, env=os.environ | environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.split("\n")
    assert "done" in [line.strip() for line in lines]
    numbers = np.array([line.split() for line in lines if len(line.split()) == len(OUTPUTS)], dtype=float)
    assert numbers.shape == (COUNT + 1, len(OUTPUTS))
    assert np.abs(numbers).max() > 1e-3
    return numbers


@pytest.fixture(scope="module")
def reference_run(fmu, tmp_path_factory):
    """What a C master finds on this machine, by the core for linux64."""
    program = tmp_path_factory.mktemp("master") / "master"
    subprocess.run([*system_compiler(), str(MASTER), "-o", str(program), "-ldl"], check=True)
    core = fmu / "binaries" / "linux64" / "beam_3.so"
    return run_master([program, *run_words(fmu, core, (fmu / "resources").as_uri())])


def cross_compiled(output, target):
    words = [*ZIG, str(MASTER), "-O3", "-s", "-target", target, "-o", str(output)]
    subprocess.run(words, check=True, capture_output=True)
    return output


@pytest.mark.slow
@needs_zig
@needs_cc
@pytest.mark.skipif(this_platform() != "linux64", reason="compares with linux64")
@pytest.mark.skipif(shutil.which("wine") is None, reason="no wine")
def test_windows_finds_the_motion_of_linux(fmu, reference_run, tmp_path):
    program = cross_compiled(tmp_path / "master.exe", "x86_64-windows-gnu")
    # Wine calls the root of this machine Z:.
    address = (fmu / "resources").as_uri().replace("file:///", "file:///Z:/")
    settings = {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"}
    # This master opens libraries by narrow characters; the resources stay where the umlaut is.
    plain = tmp_path / "beam_3.dll"
    shutil.copyfile(fmu / "binaries" / "win64" / "beam_3.dll", plain)
    core = "Z:" + str(plain).replace("/", "\\")
    found = run_master(["wine", program, *run_words(fmu, core, address)], **settings)
    subprocess.run(["wineserver", "-k"], check=False, env=os.environ | settings, capture_output=True)
    print("largest difference", np.abs(found - reference_run).max())
    np.testing.assert_allclose(found, reference_run, rtol=0, atol=1e-12)


@pytest.mark.slow
@needs_zig
@needs_cc
@pytest.mark.skipif(this_platform() != "linux64", reason="compares with linux64")
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="no qemu-user")
@pytest.mark.skipif(not ARM_LIBRARIES.is_dir(), reason="no C library of aarch64")
def test_arm_finds_the_motion_of_linux_on_x86(fmu, reference_run, tmp_path):
    program = cross_compiled(tmp_path / "master", "aarch64-linux-gnu.2.17")
    core = fmu / "binaries" / "aarch64-linux" / "beam_3.so"
    words = run_words(fmu, core, (fmu / "resources").as_uri())
    found = run_master(["qemu-aarch64", "-L", ARM_LIBRARIES, program, *words])
    print("largest difference", np.abs(found - reference_run).max())
    np.testing.assert_allclose(found, reference_run, rtol=0, atol=1e-12)


# What goes into an FMU.


def fake_compiler(output, _compiler, targets):
    """Stands for zig: a file that tells what it was asked for."""
    output.write_bytes(" ".join(targets).encode())


@pytest.mark.usefixtures("nothing_kept")
def test_an_fmu_carries_the_platforms_that_it_is_asked_for(monkeypatch, tmp_path):
    monkeypatch.setattr(binaries, "zig_compiler", lambda: ["zig"])
    monkeypatch.setattr(binaries, "compile_core", fake_compiler)
    report = Titles()
    package_fmu(beam_body(1), tmp_path / "beam.fmu", platforms=["all"], report=report)
    with zipfile.ZipFile(tmp_path / "beam.fmu") as archive:
        found = {name: archive.read(name) for name in archive.namelist() if name.startswith("binaries/")}
    assert set(found) == {f"binaries/{name}/beam_1{kind.ending}" for name, kind in PLATFORMS.items()}
    assert found["binaries/darwin64/beam_1.dylib"] == b"x86_64-macos.11.0 aarch64-macos.11.0"
    assert report.titles == [f"Compile the core for {name}" for name in PLATFORMS]
    # What is compiled once is kept.
    monkeypatch.setattr(binaries, "zig_compiler", lambda: None)
    again = Titles()
    package_fmu(beam_body(1), tmp_path / "windows.fmu", platforms=["win64", "win64"], report=again)
    with zipfile.ZipFile(tmp_path / "windows.fmu") as archive:
        assert [n for n in archive.namelist() if n.startswith("binaries/")] == ["binaries/win64/beam_1.dll"]
    assert again.titles == []


@pytest.mark.usefixtures("nothing_kept")
def test_the_python_export_carries_pythons_library_only_beside_a_core(monkeypatch, tmp_path):
    monkeypatch.setattr(binaries, "zig_compiler", lambda: ["zig"])
    monkeypatch.setattr(binaries, "compile_core", fake_compiler)
    for platforms in (["win64"], ["all"]):
        package_fmu(beam_body(1), tmp_path / "beam.fmu", Runtime.PYTHON, platforms)
        with zipfile.ZipFile(tmp_path / "beam.fmu") as archive:
            names = archive.namelist()
        folders = sorted(name.split("/")[1] for name in names if name.startswith("binaries/"))
        cores = sorted(Path(name).stem for name in names if name.startswith("resources/core/"))
        assert folders == cores == (["win64"] if platforms == ["win64"] else ["linux64", "win64"])


OTHER = next(name for name in PLATFORMS if name != this_platform())


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--platforms", "linux32"], ["'linux32'", "expected some of all, linux64, win64, darwin64, aarch64-linux"]),
        (["--platforms", "darwin64", "--runtime", "python"], ["darwin64", "only", "use the runtime native"]),
        (["--platforms", OTHER], [f"no core for {OTHER}", "pip install ziglang", "wheel"]),
    ],
)
def test_a_platform_that_cannot_be_had_is_told_before_the_body_is_reduced(monkeypatch, tmp_path, options, words):
    def never(*_):
        raise AssertionError("the body was reduced")

    monkeypatch.setattr(binaries, "zig_compiler", lambda: None)
    monkeypatch.setattr("flexfmu.build.reduce.reduce_mesh", never)
    done = CliRunner().invoke(app, ["build", str(CLAMPED), "--output", str(tmp_path / "beam.fmu"), *options])
    assert done.exit_code == 1
    said = " ".join(done.stderr.split())
    for word in words:
        assert word in said
    assert not (tmp_path / "beam.fmu").exists()


@pytest.mark.usefixtures("nothing_kept")
def test_what_the_compiler_says_reaches_the_user(monkeypatch):
    monkeypatch.setattr(binaries, "zig_compiler", lambda: [sys.executable, "-c", "raise SystemExit('no such thing')"])
    with pytest.raises(PackagingError, match=r"core for win64 does not compile.*\n?.*no such thing"):
        core_binaries(["win64"])
    monkeypatch.setattr(binaries, "zig_compiler", lambda: ["/nowhere/zig"])
    with pytest.raises(PackagingError, match=r"'/nowhere/zig' does not run"):
        core_binaries(["win64"])


@pytest.mark.usefixtures("nothing_kept")
def test_without_zig_this_machines_own_core_goes_along_with_a_warning(monkeypatch):
    monkeypatch.setattr(binaries, "zig_compiler", lambda: None)
    report = Titles()
    (found,) = core_binaries([this_platform()], report).values()
    assert found == library.library_path().read_bytes()
    assert "older systems" in report.warnings[0]


@needs_cc
def test_a_core_that_is_older_than_its_sources_is_not_called(monkeypatch):
    assert source_hash().encode() in library.library_path().read_bytes()
    library.library.cache_clear()
    monkeypatch.setattr(library, "source_hash", lambda: "0" * 64)
    with pytest.raises(OptionError, match=r"compiled from other C files .* install again \(pip install -e \."):
        library.library()


# Without a compiler.


def test_pip_is_asked_for_a_compiler_only_where_there_is_none(monkeypatch, tmp_path):
    plain = ModuleType("setuptools.build_meta")
    plain.get_requires_for_build_wheel = plain.get_requires_for_build_editable = lambda _settings: []
    monkeypatch.setitem(sys.modules, "setuptools.build_meta", plain)
    hooks = runpy.run_path(str(ROOT / ".ci" / "build_backend.py"))
    asked = [hooks[f"get_requires_for_build_{kind}"] for kind in ("wheel", "editable")]
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("FLEXFMU_PLATFORMS", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert all(any(name.startswith("ziglang") for name in ask()) for ask in asked)
    (tmp_path / "gcc").write_text("")
    (tmp_path / "gcc").chmod(0o755)
    assert not any(name.startswith("ziglang") for ask in asked for name in ask())
    monkeypatch.setenv("FLEXFMU_PLATFORMS", "all")
    assert any(name.startswith("ziglang") for name in asked[0]())


@pytest.mark.slow
@needs_zig
def test_where_there_is_no_compiler_zig_makes_this_machines_core(tmp_path):
    path = tmp_path / f"core{PLATFORMS[this_platform()].ending}"
    words = (
        "import sys; from pathlib import Path; import building\n"
        "assert building.system_compiler() is None; building.compile_for_this_machine(Path(sys.argv[1]))"
    )
    (tmp_path / "empty").mkdir()
    environment = {key: value for key, value in os.environ.items() if key != "CC"}
    environment |= {"PATH": str(tmp_path / "empty"), "PYTHONPATH": str(FOLDER)}
    done = subprocess.run(
        [sys.executable, "-c", words, path], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    core = ctypes.CDLL(str(path))
    core.fmi2FlexfmuCall.argtypes = [ctypes.c_char_p]
    assert library.declare(core)
    assert core.core_sources().decode() == source_hash()


# Sources.


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    """Native FMU for this machine, unpacked."""
    folder = tmp_path_factory.mktemp("sources") / "beam"
    package_fmu(beam_body(3), folder.with_suffix(".fmu"))
    with zipfile.ZipFile(folder.with_suffix(".fmu")) as archive:
        archive.extractall(folder)
    return folder


def test_the_description_lists_each_c_file_of_the_fmu(native):
    root = ElementTree.parse(native / "modelDescription.xml").getroot()
    listed = [file.get("name") for file in root.findall("CoSimulation/SourceFiles/File")]
    assert sorted(listed) == sorted(path.name for path in (native / "sources").glob("*.c"))
    assert listed == [path.name for path in sources()]


@pytest.mark.slow
@needs_cc
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the command is that of Linux")
def test_the_command_in_an_fmus_sources_makes_a_library_that_runs_the_same(native, tmp_path):
    read_me = (native / "sources" / "README.txt").read_text(encoding="utf-8")
    (command,) = [line.strip() for line in read_me.splitlines() if line.strip().startswith("cc ")]
    command = command.replace("cc ", " ".join(system_compiler()) + " ", 1)
    subprocess.run(command, shell=True, check=True, cwd=native / "sources")
    program = tmp_path / "master"
    subprocess.run([*system_compiler(), str(MASTER), "-o", str(program), "-ldl"], check=True)
    runs = [
        run_master([program, *run_words(native, core, (native / "resources").as_uri())])
        for core in (native / "sources" / "beam_3.so", native / "binaries" / this_platform() / "beam_3.so")
    ]
    # Of another compiler the last digits may differ.
    np.testing.assert_allclose(*runs, rtol=0, atol=1e-12)


# Wheels.


def test_the_core_of_pages_is_of_these_c_files_and_goes_with_them(monkeypatch):
    """By `python fmu_src/flexfmu/core/building.py`, with ziglang: run it where C files have changed."""
    assert source_hash().encode() in web_core()
    monkeypatch.setattr(binaries, "source_hash", lambda: "0" * 64)
    with pytest.raises(PackagingError, match=r"other C files than these; renew it: .*building\.py"):
        web_core()


@pytest.mark.slow
@needs_zig
@pytest.mark.skipif(ZIG is not None and version("ziglang") != PAGES_BY, reason=f"not ziglang {PAGES_BY}")
def test_the_core_of_pages_compiled_again_has_the_same_bytes(tmp_path):
    compile_core(tmp_path / "web.wasm", ZIG, WEB.targets)
    assert (tmp_path / "web.wasm").read_bytes() == WEB_CORE.read_bytes()


@pytest.mark.long
@needs_zig
@pytest.mark.skipif(int(version("setuptools").partition(".")[0]) < 77, reason="setuptools is older than 77")
def test_a_wheel_has_the_same_bytes_twice_and_runs_without_a_compiler(tmp_path):
    wheels = []
    for name in ("one", "two"):
        command = [sys.executable, str(ROOT / ".ci" / "build_wheel.py"), str(tmp_path / name), "--no-isolation"]
        subprocess.run(command, check=True, capture_output=True)
        wheels += (tmp_path / name).glob("*.whl")
    assert wheels[0].name == wheels[1].name
    assert "-py3-none-manylinux_2_17_x86_64.manylinux_2_17_aarch64.macosx_11_0_universal2.win_amd64" in wheels[0].name
    assert wheels[0].read_bytes() == wheels[1].read_bytes()

    installed = tmp_path / "installed"
    with zipfile.ZipFile(wheels[0]) as archive:
        cores = [Path(name).name for name in archive.namelist() if "/core/binaries/" in name]
        archive.extractall(installed)
    assert sorted(cores) == sorted(f"{name}{kind.ending}" for name, kind in PLATFORMS.items())
    words = (
        "import sys; sys.path[:0] = sys.argv[1:]; from pathlib import Path; import flexfmu.core.library as library\n"
        "from bodies import beam_body; from flexfmu.fmu.package import package_fmu; import fmpy\n"
        "assert Path(sys.argv[1]) in library.library_path().parents\n"
        "package_fmu(beam_body(3), Path('beam.fmu'), platforms=['all'])\n"
        "end = fmpy.simulate_fmu('beam.fmu', start_values={'tip.force.y': 1e3}, stop_time=0.01, output_interval=1e-3)\n"
        "assert abs(end[-1]['tip.displacement.y']) > 1e-4; print('ran')"
    )
    environment = {"PATH": "", "FLEXFMU_CACHE": "", "HOME": str(tmp_path)}
    command = [sys.executable, "-c", words, str(installed), str(ROOT / "tests")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert done.stdout.endswith("ran\n"), done.stderr
