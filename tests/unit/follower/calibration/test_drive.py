"""The file of a recorded drive."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.config import Config, default_config_path, load_config, replaced
from common.errors import ConfigError
from follower.calibration.drive import Drive, load_drive, save_drive


@pytest.fixture
def config() -> Config:
    return load_config(default_config_path())


@pytest.fixture
def drive(config: Config) -> Drive:
    features = np.full((3, len(config.leds.points), 2), 0.1)
    features[1, 2] = np.nan
    stamps = np.array([10, 20, 30])
    return Drive(stamps, features, np.full((3, 3), 0.5), stamps, np.full((3, 2), 7.0))


def test_is_read_as_it_was_written(config: Config, drive: Drive, tmp_path: Path) -> None:
    save_drive(drive, config, tmp_path / "drive.json")
    read = load_drive(tmp_path / "drive.json", config)
    for name in ("frames_ns", "features", "poses", "wheels_ns", "wheel_angle_rad"):
        np.testing.assert_array_equal(getattr(read, name), getattr(drive, name))


def test_of_another_array_is_refused(config: Config, drive: Drive, tmp_path: Path) -> None:
    save_drive(drive, config, tmp_path / "drive.json")
    moved = [(x + 0.01, y, z) for x, y, z in config.leds.positions_m]
    other = replaced(config, leds=replaced(config.leds, positions_m=tuple(moved)))
    with pytest.raises(ConfigError, match=r"drive\.json: recorded with another lens, mounting or array"):
        load_drive(tmp_path / "drive.json", other)


def _fewer_points(table: dict[str, Any]) -> None:
    table["frames"][0]["features"].pop()


def _falling(table: dict[str, Any]) -> None:
    table["wheels"].reverse()


def _no_wheels(table: dict[str, Any]) -> None:
    table["wheels"] = []


def _no_number(table: dict[str, Any]) -> None:
    table["wheels"][0][1] = "fast"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_fewer_points, "one point for each"),
        (_falling, "stamps do not rise"),
        (_no_wheels, "needs wheels"),
        (_no_number, "not a recorded drive"),
    ],
)
def test_what_is_wrong_is_named(
    config: Config, drive: Drive, tmp_path: Path, spoil: Callable[[dict[str, Any]], None], words: str
) -> None:
    path = tmp_path / "drive.json"
    save_drive(drive, config, path)
    table = json.loads(path.read_text(encoding="utf-8"))
    spoil(table)
    path.write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"drive\.json: .*{words}"):
        load_drive(path, config)
