"""The order of a grasp and of a release."""

from __future__ import annotations

from itertools import pairwise

import pytest

from common.config import Config
from follower.arms.grasp import GraspSequence
from tests.rigs.arms_rig import DT_S, EMPTY, GRIPPED, OPEN, tick


def run_grasp(
    grasp: GraspSequence, wanted: str, grip: tuple[float, float], lift_m: float, seconds: float
) -> list[str]:
    stages: list[str] = []
    for _ in range(round(seconds / DT_S)):
        step = grasp.step("open" if wanted == "open" else "closed", grip, lift_m, tick())
        if not stages or stages[-1] != step.stage:
            stages.append(step.stage)
    return stages


def test_letting_go_relaxes_first_then_opens_then_retracts(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.handle_x_m, GRIPPED, 0.2, tick().end_ns)
    held = grasp.step("closed", GRIPPED, arms.lift_height_m, tick())
    assert (held.stage, held.firmness, held.grip_torque_n_m) == ("hold", 1.0, arms.grip_torque_n_m)
    first = grasp.step("open", GRIPPED, arms.lift_height_m, tick())
    assert (first.stage, first.grip_torque_n_m) == ("relax", arms.grip_torque_n_m)
    assert run_grasp(grasp, "open", GRIPPED, arms.lift_height_m, 1.0) == ["relax", "open"]
    opening = grasp.step("open", GRIPPED, arms.lift_height_m, tick())
    assert (opening.firmness, opening.grip_torque_n_m) == (0.0, arms.release_torque_n_m)
    assert opening.handle_x_m == pytest.approx(arms.handle_x_m)
    assert run_grasp(grasp, "open", OPEN, arms.lift_height_m, 2.0) == ["retract"]
    away = grasp.step("open", OPEN, arms.lift_travel_m, tick())
    assert (away.handle_x_m, away.lift_m) == pytest.approx((arms.retracted_x_m, arms.lift_travel_m))


def test_grasping_reaches_lifts_closes_and_holds_only_what_is_there(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.retracted_x_m, OPEN, 0.2, tick().end_ns)
    assert run_grasp(grasp, "closed", OPEN, arms.lift_travel_m, 3.0) == ["reach"]
    assert run_grasp(grasp, "closed", OPEN, arms.lift_height_m, 1.0) == ["close"]
    assert run_grasp(grasp, "closed", EMPTY, arms.lift_height_m, 1.0) == ["close"]
    assert run_grasp(grasp, "closed", GRIPPED, arms.lift_height_m, 0.1) == ["close"]
    assert run_grasp(grasp, "closed", GRIPPED, arms.lift_height_m, 1.0) == ["close", "hold"]


def test_fingers_that_pass_the_angles_of_holding_hold_nothing(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.handle_x_m, OPEN, arms.lift_height_m, tick().end_ns)
    run_grasp(grasp, "closed", OPEN, arms.lift_height_m, 1.0)
    for step in range(100):
        angle = max(0.01, 0.30 - 0.005 * step)
        assert grasp.step("closed", (angle, angle), arms.lift_height_m, tick()).stage == "close"


def test_one_empty_gripper_never_opens_the_other_at_a_restart(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.handle_x_m, EMPTY, 0.2, tick().end_ns)
    assert grasp.step("closed", EMPTY, arms.lift_height_m, tick()).grip_torque_n_m > 0


def test_references_glide(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(0.40, GRIPPED, 0.2, tick().end_ns)
    places = [grasp.step("closed", GRIPPED, arms.lift_height_m, tick()).handle_x_m for _ in range(80)]
    assert max(abs(b - a) for a, b in pairwise([0.40, *places])) <= 0.10 * DT_S + 1e-12
    assert places[-1] == pytest.approx(arms.handle_x_m)
