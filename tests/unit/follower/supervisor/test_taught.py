"""Docking by taught images: read before anything is armed, refused if they are of something else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.config import Config
from common.errors import ConfigError
from common.geometry import Array, Pose2, features_at
from common.messages import DockRequest
from common.node import NodeContext
from common.timing import NS_PER_S, SteppedClock
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.node import SupervisorNode
from follower.supervisor.sequence import DockingSequence
from follower.supervisor.taught import Taught, calibration_hash, save, taught_images

NOW_NS = 10 * NS_PER_S


def with_folder(config: Config, folder: str) -> Config:
    return config.model_copy(update={"docking": config.docking.model_copy(update={"taught_dir": folder})})


def image(config: Config, trolley: int, calibration: str = "") -> Taught:
    features: Array = 0.001 + features_at(config.leds.points, config.docking.goal(trolley), config.camera.mount)
    known = calibration or calibration_hash(config.camera)
    return Taught(trolley, features, 0.1, Pose2(1.5, 0.0, 0.0), known, 0.4, 40)


def request(trolley: int) -> DockRequest:
    return DockRequest(f"dock-{trolley}", NOW_NS + NS_PER_S, "start", trolley)


def test_without_a_folder_geometry_gives_the_image(config: Config, tmp_path: Path) -> None:
    assert taught_images(config, tmp_path / "robots.toml") is None


def test_the_mission_carries_the_taught_image_and_an_untaught_docking_is_refused(
    config: Config, tmp_path: Path
) -> None:
    (tmp_path / "images").mkdir()
    for trolley in (1, 3):
        save(image(config, trolley), tmp_path / "images" / f"taught-{trolley}.json")
    taught = taught_images(with_folder(config, "images"), tmp_path / "robots.toml")
    assert taught is not None
    assert set(taught) == {1, 3}
    sequence = DockingSequence(config, 1000, taught)
    seen = SupervisorInputs(
        now_ns=NOW_NS, state=None, drives=None, arms=None, leader=None, controller_alive=False, requests=(request(2),)
    )
    refused = sequence.step(seen)
    assert refused.answers[0].outcome == "refused"
    assert "docking 2 is not taught" in refused.answers[0].reason
    assert sequence.phase == "idle"
    taken = sequence.step(replace(seen, requests=(request(3),)))
    assert taken.answers[0].outcome == "accepted"
    assert np.array(taken.mission.desired_features) == pytest.approx(image(config, 3).features)


@pytest.mark.parametrize("fault", ["missing", "calibration", "renamed", "one led short", "spoilt"])
def test_a_wrong_image_stops_the_supervisor_at_its_start(config: Config, tmp_path: Path, fault: str) -> None:
    path, good = tmp_path / "taught-1.json", image(config, 1)
    if fault == "calibration":
        save(image(config, 1, calibration="0123456789abcdef"), path)
    elif fault == "renamed":
        save(image(config, 2), path)
    elif fault == "one led short":
        save(replace(good, features=good.features[:3]), path)
    elif fault == "spoilt":
        path.write_text("{}")
    robots = with_folder(config, str(tmp_path))
    with pytest.raises(ConfigError, match=r"taught-1\.json") as said:
        SupervisorNode(NodeContext(robots, tmp_path / "robots.toml", tmp_path, 1, SteppedClock(NOW_NS)))
    assert "\n" not in str(said.value)
