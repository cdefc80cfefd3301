"""``davpc calibrate robot`` names what is wrong with its drives, and writes what it found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.errors import ConfigError
from follower.calibration.bundle import RobotCalibration
from station.calibrate.robot import content, fitted, table
from tests.rigs.recorded_run import recorded_run, recording_config


def test_too_few_drives_are_refused() -> None:
    with pytest.raises(ConfigError, match="calibrate robot: 1 drives: record 3 or more"):
        fitted([recorded_run()], recording_config())


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.mcap: cannot be read"):
        fitted([tmp_path / "none.mcap"], load_config(default_config_path()))


def test_says_what_is_not_determined() -> None:
    config = load_config(default_config_path())
    found = RobotCalibration(
        config, ("camera yaw", "LED 1 y"), ("deg", "m"), np.array([0.5, 0.001]), np.diag([1e-4, 1e-6]),
        np.array([0.6, 0.0015]), 0.06, 200,
    )  # fmt: skip
    lines = table(found).splitlines()
    assert "+0.500 ± 0.010 °" in lines[1]
    assert "not determined" not in lines[1]
    assert "not determined" in lines[2]
    kept = json.loads(json.dumps(content(found, "2026-11-28", [Path("a.mcap")])))
    assert kept["errors"]["camera yaw"]["determined"]
    assert kept["configuration"]["camera.mount_xyz_m"] == list(config.camera.mount_xyz_m)
