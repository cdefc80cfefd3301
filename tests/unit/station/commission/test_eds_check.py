"""What davpc can drive, by the EDS alone."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from station.cli import app
from station.commission.eds_check import missing_objects, refusal
from tests.rigs.canbus_rig import CONFIG_PATH, DRIVE_EDS, stepped_config


def _without(folder: Path, index: str) -> Path:
    text = DRIVE_EDS.read_text(encoding="utf-8")
    path = folder / "maker.eds"
    path.write_text(re.sub(rf"(?ms)^\[{index}(sub[0-9A-F]+)?\]\n.*?(?=^\[|\Z)", "", text), encoding="utf-8")
    return path


def test_the_reference_drive_lacks_nothing() -> None:
    config = stepped_config()
    assert not any(report.missing for report in refusal(DRIVE_EDS, config))
    assert missing_objects(config, CONFIG_PATH) == []


@pytest.mark.parametrize(
    ("index", "uses"),
    [("1029", 3), ("6072", 3), ("1A00", 3), ("607F", 1), ("60FF", 1), ("6071", 1), ("607A", 1), ("6081", 1)],
)
def test_what_is_missing_is_named_for_each_use(tmp_path: Path, index: str, uses: int) -> None:
    reports = refusal(_without(tmp_path, index), stepped_config())
    named = [report for report in reports if any(f"{index}h" in text for text in report.missing)]
    assert len(named) == uses


def test_the_command_says_it_for_many_files(tmp_path: Path) -> None:
    command: Any = CliRunner()
    files = [str(DRIVE_EDS), str(_without(tmp_path, "1029")), str(tmp_path / "none.eds")]
    assert command.invoke(app, ["can", "check-eds", files[0]]).exit_code == 0
    done = command.invoke(app, ["can", "check-eds", "--json", *files])
    assert done.exit_code == 1
    reports = json.loads(done.stdout)
    assert [bool(report["missing"]) for report in reports] == [False] * 3 + [True] * 4
    assert "cannot be read" in reports[-1]["missing"][0]
