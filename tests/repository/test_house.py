"""The house rules that no import linter can see."""

from __future__ import annotations

import ast
import re
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from common.channels import CHANNELS
from common.node import Node
from common.processes import ENTRY_POINTS, PROCESSES, process

ROOT = Path(__file__).parents[2]
PACKAGES = ("common", "follower", "gateway", "leader", "sim", "station", "experiments")
NODES = {path for package in PACKAGES for path in (ROOT / package).rglob("node.py")}
# files that are executors, devices, or for people: they may know the time
WITH_CLOCK = {
    "common/timing.py",
    "common/bus.py",
    "common/executor.py",
    "common/files/writer.py",
    "common/recording/live.py",
    "sim/can/server.py",
}


def modules_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text())
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


def sources(*packages: str) -> list[Path]:
    return [path for package in packages for path in sorted((ROOT / package).rglob("*.py"))]


def test_every_process_has_an_entry_point_and_no_entry_point_lacks_a_process() -> None:
    assert {entry.name for entry in entry_points(group=ENTRY_POINTS)} == {entry.name for entry in PROCESSES}


@pytest.mark.parametrize("name", [entry.name for entry in PROCESSES])
def test_every_nodes_name_and_channels_fit_the_tables(name: str) -> None:
    factory = process(name).factory()
    module = __import__(factory.__module__, fromlist=["make"])
    (node_type,) = {
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Node) and getattr(value, "name", None) == name
    }
    assert all(channel.publisher == name for channel in node_type.outputs if channel.kind == "state")
    assert all(channel.publisher == name for channel in node_type.serves)


def test_keys_and_names_are_unique() -> None:
    keys = [channel.key for channel in CHANNELS]
    names = [entry.name for entry in PROCESSES]
    assert len(set(keys)) == len(keys)
    assert len(set(names)) == len(names)


def test_the_architecture_shows_the_tables_as_they_are() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text()
    for entry in PROCESSES:
        assert f"| {entry.name} | {entry.robot} | {entry.rate_hz:g} | {entry.stepped_by} | {entry.priority} |" in page
    for channel in CHANNELS:
        rate = f"{channel.rate_hz:g}" if channel.rate_hz else "–"
        age = f"{channel.max_age_ms:g}" if channel.max_age_ms else "–"
        leaves = "yes" if channel.reach == "pair" else "no"
        row = f"| {channel.key} | {channel.message.__name__} | {channel.publisher} | {rate} | {age} | {leaves} |"
        assert row in page


def test_motion_keys_stay_on_the_robot() -> None:
    assert all(channel.reach == "robot" for channel in CHANNELS if "/motion/" in channel.key)


def test_algorithms_read_no_clock_and_start_no_thread() -> None:
    offenders = {
        f"{path.relative_to(ROOT)}: {module}"
        for path in sources("common", "follower", "leader", "sim")
        if str(path.relative_to(ROOT)) not in WITH_CLOCK and path not in NODES
        for module in modules_of(path) & {"time", "threading", "asyncio", "multiprocessing"}
    }
    # the inbox's lock; the journal asks which thread it is
    allowed = {"common/node.py: threading", "common/recording/journal.py: threading"}
    drivers = {
        o
        for o in offenders
        if o.startswith(("common/canopen/bus.py", "common/canopen/socketcand.py", "follower/camera/"))
    }
    assert offenders - allowed - drivers == set()


def test_the_simulated_backend_is_named_only_where_the_design_allows_it() -> None:
    """Configuration, ``davpc sim``, experiments and tests; elsewhere it is found through entry points."""
    named = {
        str(path.relative_to(ROOT))
        for path in sources("common", "follower", "leader", "station")
        if "sim" in modules_of(path) or re.search(r"\bif\b.*simulat", path.read_text())
    }
    assert all(name.startswith("station/simulate/") for name in named)


def test_lines_end_at_the_line_feed_alone() -> None:
    """``str.splitlines`` also breaks at U+2028 and its like, which JSON and logs may contain within a line."""
    assert [str(path.relative_to(ROOT)) for path in sources(*PACKAGES) if ".splitlines(" in path.read_text()] == []


def test_zenoh_can_and_mcap_are_behind_their_doors() -> None:
    using = {
        module: {str(p.relative_to(ROOT)) for p in sources(*PACKAGES) if module in modules_of(p)}
        for module in ("zenoh", "can", "canopen", "mcap")
    }
    doors = {module: {path for path in files if not path.startswith("sim/")} for module, files in using.items()}
    assert doors == {
        "zenoh": {"common/bus.py"},
        "can": {"common/canopen/bus.py", "common/canopen/socketcand.py"},
        "canopen": {"common/canopen/eds.py", "common/canopen/node.py"},
        "mcap": {"common/recording/mcap_file.py"},
    }


def test_no_path_of_one_machine_is_written_down() -> None:
    pattern = re.compile(r"/(?:root|home/\w+|work)/")
    for path in [*sources(*PACKAGES, "tests"), *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        if path != Path(__file__):
            assert not pattern.search(path.read_text()), path


def test_no_test_imports_another_test() -> None:
    """What tests of several folders share lives in ``tests/rigs``; what those of one folder share, beside them."""
    for path in sources("tests"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                named = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                named = [alias.name for alias in node.names]
            else:
                continue
            parts = {part for name in named if name.startswith("tests.") for part in name.split(".")}
            wrong = {part for part in parts if part == "conftest" or part.startswith("test_")}
            assert not wrong, f"{path.relative_to(ROOT)}:{node.lineno} imports {', '.join(named)}"


def test_unit_tests_mirror_the_product() -> None:
    """``tests/unit/<path>/test_<module>.py`` tests ``<path>/<module>.py`` or the package of that name.

    Where one file would be too long, ``test_<module>_<aspect>.py`` stand beside it. What takes several modules lies
    in ``tests/stepped`` (whole robots in stepped time) or with the module whose behaviour it asserts.
    """
    for path in sorted((ROOT / "tests/unit").rglob("test_*.py")):
        folder = ROOT / path.parent.relative_to(ROOT / "tests/unit")
        modules = {entry.stem for entry in folder.glob("*") if entry.suffix == ".py" or entry.is_dir()}
        tested = path.stem.removeprefix("test_").split("_")
        names = {"_".join(tested[:count]) for count in range(1, len(tested) + 1)}
        assert names & modules, f"{path.relative_to(ROOT)}: {folder.relative_to(ROOT)} has no such module"


def test_test_files_are_short() -> None:
    long = {str(path.relative_to(ROOT)): count for path in sources("tests") if (count := lines_of(path)) > 300}
    assert long == {}


def lines_of(path: Path) -> int:
    return len(path.read_text().splitlines())


def test_python_in_shell_scripts_imports_what_there_is() -> None:
    """No type checker reads it."""
    lines = [
        line
        for path in (ROOT / "deploy").rglob("*.sh")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.startswith(("from ", "import "))
    ]
    assert any("common.config" in line for line in lines)
    for line in lines:
        exec(line, {})


def test_product_folders_files_and_functions_are_small() -> None:
    """At most 15 files a folder beside ``__init__``, 300 lines a file but the gate's, 72 lines a function."""
    folders = {path.parent for path in sources(*PACKAGES)}
    full = {str(f.relative_to(ROOT)): n for f in folders if (n := len([*f.glob("[!_]*.py")])) > 15}
    assert full == {}
    long_files = {str(p.relative_to(ROOT)) for p in sources(*PACKAGES) if p.read_text().count("\n") > 300}
    assert long_files <= {"follower/can_bridge/gate.py"}
    long_functions = {
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in sources(*PACKAGES)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno >= 60
    }
    assert long_functions == set()


def test_no_class_name_stands_for_two_things() -> None:
    """A class that several files need is imported; private ones are their file's own."""
    places: dict[str, list[str]] = {}
    for path in sources(*PACKAGES):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
