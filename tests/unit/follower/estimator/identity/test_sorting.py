"""Among several arrays of the same shape, the one with our code is taken, and no other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from common.config import Config, LedCodeConfig
from common.geometry import Pose2
from common.led_code import level
from common.timing import NS_PER_MS, NS_PER_S
from follower.estimator.detection import Detection
from follower.estimator.pipeline import Perception
from sim.optics.image import Optics, View
from sim.optics.scenes import CLEAN, Scene, SecondArray

CODE = LedCodeConfig(number=3)
RATE_HZ = 60.0
OURS = Pose2(4.0, -1.0, 0.0)
BESIDE = SecondArray(Pose2(0.4, 2.2, 0.1))
LEFT_OUT = SecondArray(Pose2(0.4, 2.2, 0.1), code_offset=0)


@pytest.fixture(scope="module")
def coded(config: Config) -> Config:
    return config.model_copy(update={"leds": config.leds.model_copy(update={"code": CODE})})


def watched(
    config: Config, scene: Scene, seconds: float = 2.5, lit: Callable[[float], bool] = lambda _t: True
) -> list[Detection]:
    """What perception makes of a scene, standing; our own array is lit as ``lit`` says."""
    optics, perception = Optics(config.camera, config.leds, seed=1), Perception(config)
    image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    seen = []
    for frame in range(1, round(seconds * RATE_HZ) + 1):
        time_ns = round(frame * NS_PER_S / RATE_HZ)
        share = level(CODE.number, CODE.symbol_ms * NS_PER_MS, CODE.depth, time_ns + 700 * NS_PER_MS)
        currents = (share * config.leds.current_a * lit(time_ns / NS_PER_S),) * len(config.leds.points)
        optics.render(image, View(frame, OURS, currents, time_ns=time_ns, scene=scene))
        seen.append(perception.process(image, frame, time_ns, (0.0, 0.0)))
    return seen


def is_ours(detection: Detection) -> bool:
    pose = detection.pose
    return pose is not None and abs(pose.x_m - OURS.x_m) < 0.2 and abs(pose.y_m - OURS.y_m) < 0.2


def test_ours_is_confirmed_by_its_code_within_two_seconds(coded: Config) -> None:
    seen = watched(coded, CLEAN)
    first = next(k for k, each in enumerate(seen) if each.valid)
    assert {each.cause for each in seen[:first]} == {"confirming"}
    assert first / RATE_HZ <= 2.0
    assert all(each.valid and is_ours(each) for each in seen[first:])


def test_of_two_arrays_in_view_ours_is_taken(coded: Config) -> None:
    valid = [each for each in watched(coded, Scene(others=(BESIDE,))) if each.valid]
    assert valid
    assert all(is_ours(each) for each in valid)


def test_another_leaders_array_alone_is_named_and_never_valid(coded: Config) -> None:
    seen = watched(coded, Scene(others=(BESIDE,)), seconds=3.0, lit=lambda _t: False)
    assert not any(each.valid for each in seen)
    assert seen[-1].cause == "wrong_array"


def test_ours_is_found_although_another_was_seen_first(coded: Config) -> None:
    seen = watched(coded, Scene(others=(BESIDE,)), seconds=6.0, lit=lambda t: t > 2.5)
    valid = [each for each in seen if each.valid]
    assert valid
    assert all(is_ours(each) for each in valid)


def test_two_arrays_that_both_carry_our_code_are_ambiguous(coded: Config) -> None:
    seen = watched(coded, Scene(others=(LEFT_OUT,)), seconds=3.0)
    assert not any(each.valid for each in seen)
    assert seen[-1].cause == "ambiguous"


def test_ours_that_shines_steadily_from_now_on_is_lost_by_name(coded: Config) -> None:
    optics, perception = Optics(coded.camera, coded.leds, seed=1), Perception(coded)
    image = np.zeros((coded.camera.height_px, coded.camera.width_px), np.uint8)
    causes = []
    for frame in range(1, round(5.0 * RATE_HZ)):
        time_ns = round(frame * NS_PER_S / RATE_HZ)
        coded_for_now = time_ns < 2.5 * NS_PER_S
        share = level(CODE.number, CODE.symbol_ms * NS_PER_MS, CODE.depth, time_ns) if coded_for_now else 1.0
        optics.render(image, View(frame, OURS, (share,) * 4, time_ns=time_ns))
        seen = perception.process(image, frame, time_ns, (0.0, 0.0))
        causes.append("valid" if seen.valid else seen.cause)
    assert causes[round(2.4 * RATE_HZ)] == "valid"
    assert "wrong_array" in causes
    assert causes[-1] != "valid"
