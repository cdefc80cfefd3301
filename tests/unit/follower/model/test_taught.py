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
from follower.estimator.lens import Lens
from follower.model.taught import (
    Taught,
    calibration_hash,
    geometry_tag,
    load,
    save,
    taught_geometry,
    taught_images,
    taught_robots,
)
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.node import SupervisorNode
from follower.supervisor.sequence import DockingSequence
from tests.rigs.supervisor_rig import Bench

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


def test_all_processes_go_by_the_taught_image_and_the_mission_sends_its_goal(config: Config, tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for trolley in (1, 3):
        save(image(config, trolley), tmp_path / "images" / f"taught-{trolley}.json")
    robots, path = with_folder(config, "images"), tmp_path / "robots.toml"
    found = taught_geometry(robots, path)
    assert found is not None
    assert set(found.goals) == {1, 3}
    assert geometry_tag(taught_robots(robots, path)) == geometry_tag(found.config) != geometry_tag(config)
    sequence = DockingSequence(found.config, 1000, found.goals)
    seen = SupervisorInputs(
        now_ns=NOW_NS, state=None, drives=None, arms=None, leader=None, controller_alive=False, requests=(request(3),)
    )
    taken = sequence.step(seen)
    assert taken.answers[0].outcome == "accepted"
    used, configured = Lens(found.config.camera), Lens(config.camera)
    wanted = configured.to_normalised(used.to_pixels(np.array(taken.mission.desired_features)))
    assert wanted == pytest.approx(image(config, 3).features, abs=3e-4)  # 0.1 px: but for the robot's tilt
    assert taken.mission.goal_theta_rad == found.goals[3].theta_rad != 0.0


def test_an_untaught_docking_ends_at_its_goal(config: Config) -> None:
    sequence = DockingSequence(config, 1000, {1: Pose2(1.501, 0.001, 0.002)})
    seen = SupervisorInputs(
        now_ns=NOW_NS, state=None, drives=None, arms=None, leader=None, controller_alive=False, requests=(request(2),)
    )
    assert sequence.step(seen).answers[0].outcome == "accepted"
    assert sequence.attempt.goal == config.docking.goal(2)


def test_an_estimator_of_another_geometry_is_not_followed(config: Config) -> None:
    bench = Bench(config)
    bench.to_approach()
    assert bench.seen.state is not None
    decided = bench.step(state=replace(bench.seen.state, geometry="0123456789abcdef"))
    assert decided.mission.motion == "hold"
    assert "restart davpc-follower.target" in decided.mission.waiting


def test_an_image_that_no_tolerance_explains_is_refused(config: Config, tmp_path: Path) -> None:
    good = image(config, 1)
    swapped = replace(good, features=good.features[[1, 0, 2, 3]])
    save(swapped, tmp_path / "taught-1.json")
    with pytest.raises(ConfigError, match=r"times docking\.taught's tolerances .*: measure camera and LEDs") as said:
        taught_robots(with_folder(config, str(tmp_path)), tmp_path / "robots.toml")
    assert "\n" not in str(said.value)


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


@pytest.mark.parametrize(
    "changes",
    [
        {"width_px": 640},
        {"height_px": 480},
        {"mount_xyz_m": (0.0, 0.0, 0.9)},
        {"mount_tilt_deg": (0.0, 3.0, 0.0)},
    ],
)
def test_an_image_of_another_camera_mounting_is_refused(
    config: Config, tmp_path: Path, changes: dict[str, object]
) -> None:
    other = config.camera.model_copy(update=changes)
    assert calibration_hash(other) != calibration_hash(config.camera)
    save(image(config, 1), tmp_path / "taught-1.json")
    with pytest.raises(ConfigError, match="another lens or mounting"):
        load(tmp_path / "taught-1.json", other)


def test_another_lens_or_exposure(config: Config) -> None:
    lens = config.camera.lens.model_copy(update={"fx_px": 1.02 * config.camera.lens.fx_px})
    assert calibration_hash(config.camera.model_copy(update={"lens": lens})) != calibration_hash(config.camera)
    rate = config.camera.model_copy(update={"rate_hz": 30.0})
    assert calibration_hash(rate) == calibration_hash(config.camera), "the image does not depend on it"


@pytest.mark.parametrize("content", [None, b"{", b'{"schema": "taught/1"}'])
def test_a_file_that_is_no_image_is_named(config: Config, tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "taught-1.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as refused:
        load(path, config.camera)
    assert str(refused.value).startswith(f"{path}: not a desired image")


def test_the_file_is_of_schema_taught_1(config: Config, tmp_path: Path) -> None:
    """Files of installed robots: another name would refuse them all."""
    save(image(config, 1), tmp_path / "taught-1.json")
    assert '"schema": "taught/1"' in (tmp_path / "taught-1.json").read_text()
