"""What is cited exists: ids of docs/safety.md, documents, paths; and every id of the safety concept has a test."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.channels import CHANNELS

ROOT = Path(__file__).parents[2]
SAFETY = ROOT / "docs/safety.md"
PAGES = [
    *(ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")),
    *sorted(ROOT.glob("docs/**/*.md")),
]
TEXT = {".py", ".md", ".toml", ".sh", ".yaml", ".service", ".conf", ".target", ".rules", ""}
# words that cite what a reader of this repository cannot open
STRAY = re.compile(
    r"SAFETY\.md|SAFETY,? rows?\b|DESIGN\.md|\bthe design (?:says|said|allows|has it)|\bof the design\b"
    r"|\bthe safety concept\b|\brows? \d\d\b(?! [a-z])|\b[Ee]qs?\. \([a-z_]+\)"
)
_ID = re.compile(r"\b([SP])(\d\d)(?:–([SP])(\d\d))?\b")
_DOCUMENT = re.compile(r"[\w./-]+\.md\b")
_DOCUMENT_IN_CODE = re.compile(r"\b(?:docs/[\w./-]+|[A-Z]{4,})\.md\b")  # others are files that code writes
_QUOTED = re.compile(r"`([^`\n]+)`")
_PATH = re.compile(r"[\w.*-]+(?:/[\w.*@-]+)*/?")
# no paths: a module of the camera's maker, and keys of messages
_OTHER = {"mvsdk.py", *(channel.key for channel in CHANNELS)}


def tracked() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("no git: which files belong to the repository is not known")
    names = [name for name in listed.stdout.split("\0") if name]
    return [ROOT / name for name in names if (ROOT / name).is_file()]


def texts() -> Iterator[tuple[str, str]]:
    """Path below the root and text of each file of the repository but this one and the changelog."""
    for path in tracked():
        if path.suffix in TEXT and path not in (Path(__file__), ROOT / "CHANGELOG.md"):
            yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """Cells of the rows of ``docs/safety.md`` below a heading that begin with an id."""
    section = SAFETY.read_text(encoding="utf-8").partition(f"\n{heading}\n")[2]
    section = re.split(r"\n#", section)[0]
    lines = [line for line in section.splitlines() if re.match(r"\| [SP]\d\d \|", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


MODES, EVIDENCE, FIGURES = (
    rows("## Failure modes"),
    rows("### Where it is built, and what shows it"),
    rows("## Figures to reach"),
)
IDS = [f"S{number:02}" for number in range(1, 50)] + [f"P{number:02}" for number in range(1, 14)]


def cited_ids(text: str) -> set[str]:
    """Ids in a text, also those within a range as S07–S13."""
    found = set()
    for letter, first, _, last in _ID.findall(text):
        found |= {f"{letter}{number:02}" for number in range(int(first), int(last or first) + 1)}
    return found


def missing_paths(text: str, folder: Path) -> set[str]:
    """Paths in backticks that are not there, from the root; a bare module counts from the path before it."""
    top = {path.name for path in ROOT.iterdir()} - {"out"}  # what runs leave is none of the repository
    missing = set()
    for quoted in _QUOTED.findall(text):
        if not _PATH.fullmatch(quoted) or quoted in _OTHER or (ROOT / "tests" / quoted).is_file():
            continue
        if "/" in quoted and quoted.split("/")[0] in top:
            if not any(ROOT.glob(quoted.rstrip("/"))):
                missing.add(quoted)
            folder = (ROOT / quoted).parent if "." in quoted.rsplit("/", 1)[-1] else ROOT / quoted
        elif quoted.endswith(".py") and "/" not in quoted and not any(folder.glob(quoted)):
            missing.add(quoted)
    return missing


def test_the_checks_themselves_notice() -> None:
    assert cited_ids("`docs/safety.md S07–S09`, P01 and S0, S1, SO3, S123") == {"S07", "S08", "S09", "P01"}
    assert missing_paths("`common/node.py`, `bus.py`, `docs/`, `a/b.py`, `make test`", ROOT) == set()
    assert missing_paths("`common/nowhere.py`, `common/node.py` and `nothing.py`", ROOT) == {
        "common/nowhere.py",
        "nothing.py",
    }
    for text in (
        "SAFETY.md row 22",
        "as the design says",
        "(SAFETY row 45)",
        "the safety concept",
        "of row 38.",
        "eq. (eso)",
    ):
        assert STRAY.search(text)
    assert not STRAY.search("design of the gate; 15 rows; every row of the image; row 12 of the table; eq. (28a)")


def test_the_safety_page_has_each_id_once() -> None:
    assert [row[0] for row in MODES + FIGURES] == IDS
    assert [row[0] for row in EVIDENCE] == [row[0] for row in MODES]
    assert {len(row) for row in MODES} == {5}
    assert {row[4] for row in MODES} <= {"built", "partly", "not yet"}


@pytest.mark.parametrize("row", [*EVIDENCE, *FIGURES], ids=lambda row: row[0])
def test_each_id_names_its_tests_or_why_it_has_none(row: list[str]) -> None:
    tested_by = row[2] if row[0].startswith("S") else row[3]
    if not tested_by.startswith("not tested: "):
        assert _QUOTED.findall(tested_by)
    for quoted in _QUOTED.findall(tested_by):
        assert " " in quoted or (ROOT / "tests" / quoted).is_file(), quoted


@pytest.mark.parametrize("mode", MODES, ids=lambda row: row[0])
def test_the_status_fits_what_is_said_to_be_missing(mode: list[str]) -> None:
    evidence = next(row for row in EVIDENCE if row[0] == mode[0])
    if mode[4] == "built":
        assert not evidence[2].startswith("not tested")
    else:
        assert evidence[3], "say what is missing"


def test_every_id_that_is_cited_exists() -> None:
    for name, text in texts():
        assert cited_ids(text) <= set(IDS), name


def test_every_document_that_is_cited_exists() -> None:
    lost = set()
    for name, text in texts():
        pattern = _DOCUMENT if name.endswith(".md") else _DOCUMENT_IN_CODE
        for document in set(pattern.findall(re.sub(r"\w+://\S+", "", text))):
            places = (ROOT / document, (ROOT / name).parent / document)
            if not any(place.is_file() for place in places):
                lost.add(f"{name}: {document}")
    assert lost == set()


def test_nothing_cites_what_cannot_be_opened() -> None:
    stray = {f"{name}: {match.group()}" for name, text in texts() for match in STRAY.finditer(text)}
    assert stray == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_path_in_backticks_exists(page: Path) -> None:
    assert missing_paths(page.read_text(encoding="utf-8"), page.parent) == set()
