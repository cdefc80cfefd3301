"""Pixel level: rendered frames, the whole perception and the controller process's code, in stepped time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.geometry import Pose2
from experiments.feature_level import table1
from experiments.feature_level.feature_world import Disturbances
from experiments.feature_level.pixels.pilots import PixelPilotFactory
from experiments.feature_level.pixels.world import PixelWorld
from experiments.feature_level.scenes import DISTURBANCES, pixel_config
from experiments.feature_level.trial import Outcome, fly_in, goal_task
from experiments.shared.executor import ALONE

CONFIG = load_config(default_config_path())
NEAR_START = Pose2(-2.2, 0.06, -0.05)
FRAME_NS = 16_666_667


def _fly(factory: PixelPilotFactory, seed: int, duration_s: float) -> Outcome:
    world = PixelWorld(factory.task.config, NEAR_START, [seed, 0], DISTURBANCES["none"])
    return fly_in(world, factory.task, factory.make(), duration_s)


def test_a_short_approach_is_deterministic_and_arrives() -> None:
    factory = PixelPilotFactory("davpc", goal_task(pixel_config(CONFIG, "davpc")))
    whole, again, other = _fly(factory, 1, 9.0), _fly(factory, 1, 1.0), _fly(factory, 2, 1.0)
    assert whole.metrics["e_y_cm"] < 0.3
    assert whole.metrics["e_x_cm"] < 1.0
    assert whole.metrics["e_theta_deg"] < 0.15
    assert whole.metrics["lost"] == 0.0
    commands = whole.trace.arrays()["command"][:20]
    np.testing.assert_array_equal(again.trace.arrays()["command"], commands)
    assert not np.array_equal(other.trace.arrays()["command"], commands)


@pytest.mark.parametrize("method", ["ibvs", "vpc"])
def test_other_methods_fly_on_what_perception_measures(method: str) -> None:
    factory = PixelPilotFactory(method, goal_task(pixel_config(CONFIG, method)))
    trace = _fly(factory, 1, 1.5).trace.arrays()
    assert trace["command"][0] == pytest.approx([0.0, 0.0])  # nothing is confirmed yet
    assert trace["pose"][-1][0] > NEAR_START.x_m + 0.03
    assert abs(trace["pose"][-1][1]) < 0.1


def test_a_command_acts_after_the_latency() -> None:
    config = CONFIG.model_copy(update={"base": CONFIG.base.model_copy(update={"latency_ms": 20.0})})
    world = PixelWorld(config, NEAR_START, [1, 0], Disturbances(lag_s=1e-4))
    world.measure(0)
    world.command = (0.2, 0.0)
    world.advance(1 / 60)
    assert world.wheels == (0.0, 0.0)
    world.advance(1 / 60)
    assert world.wheels[0] == pytest.approx(0.2, rel=1e-3)
    assert world.follower_in_leader.x_m - NEAR_START.x_m == pytest.approx(0.2 * (2 / 60 - 0.020), rel=0.02)


def test_perception_sees_the_array_of_the_true_pose() -> None:
    world = PixelWorld(pixel_config(CONFIG, "ibvs"), NEAR_START, [1, 0], DISTURBANCES["none"])
    seen = world.measure(0)
    assert np.isnan(seen.features).all()  # a new lock has to be confirmed
    for frame in range(1, 6):
        seen = world.measure(frame * FRAME_NS)
    assert seen.state.valid
    pixels = CONFIG.camera.pinhole.to_pixels(seen.features)
    np.testing.assert_allclose(pixels, world.true_pixels(), atol=0.3)
    assert seen.theta_rad == pytest.approx(-NEAR_START.theta_rad, abs=0.05)


def test_table1_says_its_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "experiments.feature_level.runs.fly_in", lambda world, task, pilot: fly_in(world, task, pilot, 0.2)
    )
    runs = [
        table1.run(tmp_path / str(i), 2, ALONE, CONFIG, trials=1, methods=("davpc",), cases=("T",), pixels=True)
        for i in range(2)
    ]
    assert runs[0] == runs[1] == json.loads((tmp_path / "0/results.json").read_text())
    assert runs[0]["settings"]["level"] == "pixels"
    assert runs[0]["settings"]["cases"] == ["T_pixels"]
    assert [(entry["method"], entry["case"]) for entry in runs[0]["rows"]] == [("davpc", "T")]
    with pytest.raises(ValueError, match="T_tilted"):
        table1.run(tmp_path, 1, ALONE, CONFIG, trials=1, methods=("davpc",), cases=("T_tilted",), pixels=True)
