"""Impedance: within the joints' limits, towards the handle, and what it takes from all six joints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Pose2
from common.timing import NS_PER_MS
from follower.arms.impedance import HandleImpedance
from follower.arms.posture import PostureTracker, handle_force
from tests.rigs.arms_rig import angles, holding_angles


@given(
    q=st.tuples(*[angles] * 6),
    speeds=st.tuples(*[st.floats(-3.0, 3.0)] * 6),
    reference=st.builds(Pose2, st.floats(-1, 2), st.floats(-1, 1), st.floats(-3, 3)),
    push_n=st.floats(-500, 500),
    firmness=st.floats(0, 1),
)
def test_no_joint_ever_gets_more_than_its_limit(
    config: Config, q: tuple[float, ...], speeds: tuple[float, ...], reference: Pose2, push_n: float, firmness: float
) -> None:
    sense = PostureTracker(config.arms)
    sense.posture(q, 0)
    posture = sense.posture(tuple(a + 0.01 * w for a, w in zip(q, speeds, strict=True)), 10 * NS_PER_MS)
    torques = HandleImpedance(config.arms).torques(posture, reference, push_n, firmness)
    assert all(abs(torque) <= config.arms.joint_torque_limit_n_m for torque in torques)
    assert all(map(math.isfinite, torques))


@given(force=st.tuples(st.floats(-60, 60), st.floats(-60, 60)))
def test_the_force_at_the_handle_is_felt_through_all_six_joints(config: Config, force: tuple[float, float]) -> None:
    posture = PostureTracker(config.arms).posture(holding_angles(config), 0)
    wrench = np.array([force[0] / 2, force[1] / 2, 1.5])
    held = tuple(float(t) for jacobian in posture.jacobians for t in jacobian.T @ wrench)
    assert handle_force(posture, held) == pytest.approx(force, abs=1e-9)


def test_a_displaced_handle_is_pulled_back_in_its_own_frame(config: Config) -> None:
    arms, held = config.arms, Pose2(config.arms.handle_x_m, 0.0, 0.0)
    impedance, stiffness = HandleImpedance(arms), 2 * arms.held_stiffness[0]
    for x_mm, push_n in ((-5.0, 0.0), (4.0, 0.0), (0.0, 12.0)):
        posture = PostureTracker(arms).posture(holding_angles(config, arms.handle_x_m + x_mm / 1000), 0)
        force = handle_force(posture, impedance.torques(posture, held, push_n, 1.0))
        assert force == pytest.approx([-stiffness * x_mm / 1000 + push_n, 0.0], abs=1e-6)
    free = impedance.torques(posture, Pose2(arms.handle_x_m + 0.01, 0.0, 0.0), 0.0, 0.0)
    assert handle_force(posture, free)[0] == pytest.approx(2 * arms.free_stiffness[0] * 0.01)


def test_damping_opposes_motion(config: Config) -> None:
    arms = config.arms
    sense = PostureTracker(arms)
    sense.posture(holding_angles(config, arms.handle_x_m - 0.002), 0)
    posture = sense.posture(holding_angles(config, arms.handle_x_m), 10 * NS_PER_MS)
    torques = HandleImpedance(arms).torques(posture, Pose2(arms.handle_x_m, 0.0, 0.0), 0.0, 1.0)
    assert handle_force(posture, torques)[0] < -0.3 * 2 * arms.held_damping[0] * 0.2
