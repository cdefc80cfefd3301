"""What people give on the command line is refused in one line before any work is done."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from common.errors import ConfigError
from station.bench import bench
from station.cli import app
from station.experiment import experiment
from station.options import numbers, results_folder, writable


def test_numbers_are_finite_and_as_many_as_wanted() -> None:
    assert numbers("6,1.5,-2", 3) == (6.0, 1.5, -2.0)
    for text in ("6,1.5", "6,x,0", "nan,0,0", "6,inf,0", ""):
        with pytest.raises(ConfigError, match="write 3 numbers"):
            numbers(text, 3)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    assert writable(tmp_path / "new.toml") == tmp_path / "new.toml"
    with pytest.raises(ConfigError, match=r"new\.toml: cannot be written: no folder"):
        writable(tmp_path / "missing" / "new.toml")
    with pytest.raises(ConfigError, match="a folder"):
        writable(tmp_path)


@pytest.mark.parametrize(
    "command",
    [
        ["calibrate", "camera", "."],
        ["calibrate", "view", "2,0,0"],
        ["camera", "snapshot"],
        ["teach", "1"],
    ],
    ids=" ".join,
)
def test_a_result_that_cannot_be_stored_is_refused_before_the_work(tmp_path: Path, command: list[str]) -> None:
    out = tmp_path / "missing" / "out.png"
    result = CliRunner().invoke(app, [*command, "--out", str(out)])
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception).startswith(f"{out}: cannot be written: no folder")


def test_a_folder_for_results_may_be_there_or_be_made(tmp_path: Path) -> None:
    for out in (tmp_path, tmp_path / "new" / "deep"):
        assert results_folder(out) == out
        assert out.is_dir()


@pytest.mark.parametrize(
    "command",
    [
        (group, command.name or command.callback.__name__)
        for group, commands in (("experiment", experiment), ("bench", bench))
        for command in commands.registered_commands
        if command.callback is not None
    ],
    ids=" ".join,
)
def test_no_experiment_is_run_whose_results_cannot_be_stored(tmp_path: Path, command: tuple[str, str]) -> None:
    (tmp_path / "file").touch()
    result = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "file" / "deep")])
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception) == f"--out {tmp_path}/file/deep: cannot be written to: Not a directory"
