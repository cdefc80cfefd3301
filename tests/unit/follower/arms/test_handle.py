"""Kinematics, impedance, grasp, and what the arms feel and hold."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import Config
from common.errors import ConfigError
from common.geometry import Pose2, wrap_angle
from common.messages import Drives
from common.node import NodeContext
from common.timing import NS_PER_MS, SteppedClock
from experiments.contact.handle_bench import resting_mission
from follower.arms.collision_detection import CollisionDetector
from follower.arms.contact_detection import ContactDetector
from follower.arms.grasp import GraspSequence
from follower.arms.handle import HandleHold
from follower.arms.impedance import HandleImpedance
from follower.arms.kinematics import Angles, ReachError, ScaraArm, check_postures, grip_poses, make_arms
from follower.arms.node import ArmsNode
from follower.arms.posture import PostureTracker, handle_force
from follower.arms.sampling import SampleInterval
from follower.arms.slip_detection import SlipDetector
from tests.unit.follower.supervisor.test_sequence import DRIVES, Bench

angles = st.floats(-2.5, 2.5)
joint_angles = st.tuples(angles, angles, angles)
torques = st.floats(-20.0, 20.0)
GRIPPED, OPEN, EMPTY = (0.15, 0.15), (1.2, 1.2), (0.0, 0.15)
DT_S = 0.01
_time_ns = 0


def tick(cycles: int = 1) -> SampleInterval:
    """The next interval of 10 ms, or of several."""
    global _time_ns
    begin_ns, _time_ns = _time_ns, _time_ns + cycles * 10 * NS_PER_MS
    return SampleInterval(begin_ns, _time_ns)


@pytest.fixture(scope="module")
def arms(config: Config) -> tuple[ScaraArm, ScaraArm]:
    return make_arms(config.arms)


def holding_angles(config: Config, x_m: float | None = None) -> tuple[float, ...]:
    handle = Pose2(config.arms.handle_x_m if x_m is None else x_m, 0.0, 0.0)
    poses = grip_poses(handle, config.arms.grip_half_width_m)
    left, right = (arm.solve(pose) for arm, pose in zip(make_arms(config.arms), poses, strict=True))
    return (*left, *right)


# --- kinematics


@given(q=joint_angles, side=st.integers(0, 1))
def test_the_jacobian_is_the_derivative_of_the_gripper_pose(
    arms: tuple[ScaraArm, ScaraArm], q: Angles, side: int
) -> None:
    arm, step = arms[side], 1e-6
    for joint in range(3):
        ahead, behind = (
            arm.forward((q[0] + d * (joint == 0), q[1] + d * (joint == 1), q[2] + d * (joint == 2)))
            for d in (step, -step)
        )
        slope = (ahead.as_array() - behind.as_array()) / (2 * step)
        slope[2] = wrap_angle(ahead.theta_rad - behind.theta_rad) / (2 * step)
        assert arm.jacobian(q)[:, joint] == pytest.approx(slope, abs=1e-6)


@given(q=joint_angles.filter(lambda q: abs(q[1]) > 0.01), side=st.integers(0, 1))
def test_both_elbows_reach_the_pose_and_one_of_them_is_where_it_came_from(
    arms: tuple[ScaraArm, ScaraArm], q: Angles, side: int
) -> None:
    pose = arms[side].forward(q)
    found = arms[side].inverse(pose)
    for solution in found:
        back = arms[side].forward(solution)
        assert (back.x_m, back.y_m) == pytest.approx((pose.x_m, pose.y_m), abs=1e-9)
        assert wrap_angle(back.theta_rad - pose.theta_rad) == pytest.approx(0.0, abs=1e-9)
    assert found[0][1] < 0 < found[1][1]
    nearest = min(max(abs(wrap_angle(a - b)) for a, b in zip(q, solution, strict=True)) for solution in found)
    assert nearest < 1e-6


def test_the_right_arm_is_the_left_ones_mirror_image_and_elbows_point_outwards(config: Config) -> None:
    held = holding_angles(config)
    assert held[3:] == pytest.approx([-angle for angle in held[:3]])
    left = make_arms(config.arms)[0]
    elbow_y = left.base_xy_m[1] + left.link_m[0] * math.sin(held[0])
    assert elbow_y > max(left.base_xy_m[1], config.arms.grip_half_width_m)


def test_an_unreachable_pose_names_the_arm_and_the_reason(arms: tuple[ScaraArm, ScaraArm]) -> None:
    with pytest.raises(
        ReachError, match=r"right arm: gripper at x 0\.900 m, y -0\.200 m is out of reach: wrist 0\.7"
    ):
        arms[1].solve(Pose2(0.9, -0.2, 0.0))
    with pytest.raises(ReachError, match=r"left arm: .* needs joint 3 at .*°, its limits are -120\.0° to 120\.0°"):
        arms[0].solve(Pose2(0.30, 0.2, math.pi))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"handle_x_m": 0.70}, r"robots\.toml: arms\.handle_x_m: left arm: .* out of reach"),
        ({"retracted_x_m": -0.40}, r"robots\.toml: arms\.retracted_x_m: left arm: .* out of reach"),
        ({"joint_limits_deg": ((-5.0, 5.0), (-150.0, 10.0), (-120.0, 120.0))}, r"handle_x_m: left arm: .* joint 1"),
    ],
)
def test_arms_that_cannot_hold_the_handle_are_refused_before_anything_is_enabled(
    config: Config, change: dict[str, object], said: str
) -> None:
    broken = config.model_copy(update={"arms": config.arms.model_copy(update=change)})
    with pytest.raises(ConfigError, match=said) as refused:
        check_postures(broken.arms, "robots.toml")
    assert "\n" not in str(refused.value)


def test_the_arms_process_does_not_start_with_a_handle_out_of_reach(config: Config, tmp_path: object) -> None:
    broken = config.model_copy(update={"arms": config.arms.model_copy(update={"handle_x_m": 0.8})})
    path = type(tmp_path)("pair.toml")  # type: ignore[call-arg]
    with pytest.raises(ConfigError, match=r"pair\.toml: arms\.handle_x_m"):
        ArmsNode(NodeContext(broken, path, path, 1, SteppedClock()))  # type: ignore[arg-type]


# --- impedance


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
    told = HandleImpedance(config.arms).torques(posture, reference, push_n, firmness)
    assert all(abs(torque) <= config.arms.joint_torque_limit_n_m for torque in told)
    assert all(map(math.isfinite, told))


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
    told = HandleImpedance(arms).torques(posture, Pose2(arms.handle_x_m, 0.0, 0.0), 0.0, 1.0)
    assert handle_force(posture, told)[0] < -0.3 * 2 * arms.held_damping[0] * 0.2


# --- grasp


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
    grasp.restart(arms.handle_x_m, GRIPPED, 0.2, _time_ns)
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
    grasp.restart(arms.retracted_x_m, OPEN, 0.2, _time_ns)
    assert run_grasp(grasp, "closed", OPEN, arms.lift_travel_m, 3.0) == ["reach"]
    assert run_grasp(grasp, "closed", OPEN, arms.lift_height_m, 1.0) == ["close"]
    assert run_grasp(grasp, "closed", EMPTY, arms.lift_height_m, 1.0) == ["close"]
    assert run_grasp(grasp, "closed", GRIPPED, arms.lift_height_m, 0.1) == ["close"]
    assert run_grasp(grasp, "closed", GRIPPED, arms.lift_height_m, 1.0) == ["close", "hold"]


def test_fingers_that_pass_the_angles_of_holding_hold_nothing(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.handle_x_m, OPEN, arms.lift_height_m, _time_ns)
    run_grasp(grasp, "closed", OPEN, arms.lift_height_m, 1.0)
    for step in range(100):
        angle = max(0.01, 0.30 - 0.005 * step)
        assert grasp.step("closed", (angle, angle), arms.lift_height_m, tick()).stage == "close"


def test_one_empty_gripper_never_opens_the_other_at_a_restart(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(arms.handle_x_m, EMPTY, 0.2, _time_ns)
    assert grasp.step("closed", EMPTY, arms.lift_height_m, tick()).grip_torque_n_m > 0


def test_references_glide(config: Config) -> None:
    arms = config.arms
    grasp = GraspSequence(arms)
    grasp.restart(0.40, GRIPPED, 0.2, _time_ns)
    places = [grasp.step("closed", GRIPPED, arms.lift_height_m, tick()).handle_x_m for _ in range(80)]
    assert max(abs(b - a) for a, b in pairwise([0.40, *places])) <= 0.10 * DT_S + 1e-12
    assert places[-1] == pytest.approx(arms.handle_x_m)


# --- contact, slip, collision


def feel_for(
    sense: ContactDetector, force_n: float, seconds: float, acceleration: float = 0.0, expected: bool = True
) -> ContactDetector:
    for _ in range(round(seconds / DT_S)):
        sense.step(force_n, acceleration, tick(), expected=expected)
    return sense


def test_contact_lasts_and_has_hysteresis(config: Config) -> None:
    threshold = config.arms.contact_force_n
    sense = ContactDetector(config.arms)
    assert not feel_for(sense, 0.9 * threshold, 3.0).contact
    assert not feel_for(sense, 2 * threshold, 0.08).contact
    assert not feel_for(sense, 0.0, 0.5).contact
    assert feel_for(sense, 1.5 * threshold, 0.5).contact
    assert feel_for(sense, 0.7 * threshold, 1.0).contact
    assert not feel_for(sense, 0.3 * threshold, 0.5).contact


def test_a_rigid_connection_takes_more_than_the_guide(config: Config) -> None:
    sense = ContactDetector(config.arms)
    assert (feel_for(sense, 55.0, 1.0).contact, sense.connected) == (True, False)
    assert feel_for(sense, 100.0, 0.4).connected
    assert feel_for(sense, 60.0, 0.4).connected
    assert not feel_for(sense, 30.0, 0.4).connected


def test_contact_needs_the_visual_error_too_connection_does_not(config: Config) -> None:
    sense = ContactDetector(config.arms)
    assert not feel_for(sense, 60.0, 2.0, expected=False).contact
    assert feel_for(sense, 60.0, 0.5).contact
    assert feel_for(ContactDetector(config.arms), 100.0, 0.5, expected=False).connected


def test_contact_counts_from_the_learned_resistance_and_allows_for_inertia(config: Config) -> None:
    threshold, sense = config.arms.contact_force_n, ContactDetector(config.arms)
    for _ in range(500):
        sense.step(12.0, 0.0, tick(), rolling=True)
    assert sense.resistance_n == pytest.approx(12.0, abs=0.2)
    assert not feel_for(sense, threshold + 8.0, 1.0).contact
    assert feel_for(sense, threshold + 15.0, 1.0).contact
    assert not feel_for(ContactDetector(config.arms), threshold + 10.0, 1.0, acceleration=0.5).contact


def test_a_resistance_that_is_learned_stays_bounded(config: Config) -> None:
    sense = ContactDetector(config.arms)
    for force in [200.0] * 5 + [20.0] * 300 + [-50.0] * 300:
        sense.step(force, 0.0, tick(), rolling=True)
        assert 0.0 <= sense.resistance_n <= config.arms.pushing_force_n


def test_a_collision_is_two_samples_over_the_limit_or_a_fast_rise(config: Config) -> None:
    limit, rate = config.arms.collision_torque_n_m, config.arms.collision_rate_n_m_s
    one = CollisionDetector(config.arms)
    slow = [limit * i / 100 for i in range(100)]
    assert not any(one.step((torque, *[0.0] * 5), tick().end_ns) for torque in slow)
    assert not one.step((0.0, limit + 0.1, *[0.0] * 4), tick(20).end_ns)
    assert not one.step((0.0, limit - 0.1, *[0.0] * 4), tick().end_ns)
    assert not one.step((0.0, -limit - 0.1 + 2 * limit + 0.2, *[0.0] * 4), tick().end_ns)
    assert one.step((0.0, limit + 0.1, *[0.0] * 4), tick().end_ns)
    two = CollisionDetector(config.arms)
    assert not any(two.step((0.0,) * 6, tick().end_ns) for _ in range(10))
    rising = [two.step((*[0.0] * 5, -1.5 * rate * DT_S * i), tick().end_ns) for i in range(1, 5)]
    assert rising == [False, False, False, True]
    # as when casters swing round
    assert not any(two.step((*[0.0] * 5, -6.0 * rate * DT_S), tick().end_ns) for _ in range(9))
    once = [6.0, 8.5, 8.5, 11.5, 11.5, 11.5, 11.5]
    assert not any(two.step((*[0.0] * 5, -share * rate * DT_S), tick().end_ns) for share in once)
    two.forget()
    assert not two.step((*[0.0] * 5, 0.9 * limit), tick().end_ns)


def test_a_slip_is_a_jump_of_a_finger_or_a_lost_grip_torque(config: Config) -> None:
    full = (config.arms.grip_torque_n_m,) * 2
    sense = SlipDetector(config.arms)
    assert not any(sense.step(GRIPPED, (0.0, 0.0), tick()) for _ in range(20))
    assert not sense.suspected
    assert not any(sense.step(GRIPPED, full, tick()) for _ in range(100))
    assert sense.step((0.15, 0.15 - 1.2 * config.arms.slip_jump_rad), full, tick())
    sense.forget()
    assert not any(sense.step(GRIPPED, full, tick()) for _ in range(100))
    weak = [sense.step(GRIPPED, (full[0], 0.4 * full[1]), tick()) for _ in range(5)]
    assert (weak[0], weak[-1]) == (False, True)


# --- all together


def measured(config: Config, now_ms: int, **changes: object) -> Drives:
    base = replace(
        DRIVES, state="armed", epoch=1, measured_ns=now_ms * NS_PER_MS, joint_angle_rad=holding_angles(config),
        grip_angle_rad=GRIPPED, grip_torque_n_m=(config.arms.grip_torque_n_m,) * 2,
    )  # fmt: skip
    return replace(base, **changes)  # type: ignore[arg-type]


def test_a_slip_is_named_until_the_next_epoch_and_the_arms_yield(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    for now in range(0, 1000, 10):
        drives = measured(config, now)
        assert hold.feel(drives, mission).cause == "ok"
        hold.hold(drives, mission)
    drives = measured(config, 1000, grip_angle_rad=EMPTY)
    assert hold.feel(drives, mission).cause == "slip"
    told = hold.hold(drives, mission)
    assert max(map(abs, told.joint_torque_n_m)) < 0.1
    assert told.grip_torque_n_m == (config.arms.grip_torque_n_m,) * 2
    assert hold.feel(measured(config, 1010), mission).cause == "slip"
    assert hold.feel(measured(config, 1020), replace(mission, epoch=2)).cause == "ok"


def test_grippers_report_what_they_hold(config: Config) -> None:
    mission = resting_mission(config)
    for grip, expected in ((GRIPPED, (True, False)), (OPEN, (False, True)), (EMPTY, (False, False))):
        state = HandleHold(config.arms, config.base).feel(measured(config, 10, grip_angle_rad=grip), mission)
        assert (state.gripped, state.released) == expected


def test_nothing_jumps_when_the_drives_begin_to_obey(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    joint_angle_rad = holding_angles(config, config.arms.handle_x_m - 0.04)
    told = []
    for now in range(0, 600, 10):
        state = "enabling" if now < 300 else "armed"
        drives = measured(config, now, state=state, joint_angle_rad=joint_angle_rad)
        hold.feel(drives, mission)
        told.append(hold.hold(drives, mission).joint_torque_n_m)
    steps = [max(abs(b - a) for a, b in zip(*pair, strict=True)) for pair in pairwise(told)]
    assert max(steps) < 0.5
    assert max(map(abs, told[-1])) > 3.0


def test_the_push_follows_the_measured_resistance_and_the_commanded_direction(config: Config) -> None:
    hold, mission = HandleHold(config.arms, config.base), resting_mission(config)
    posture = PostureTracker(config.arms).posture(holding_angles(config), 0)
    torque = tuple(float(t) for jacobian in posture.jacobians for t in jacobian.T @ np.array([6.0, 0.0, 0.0]))

    def pushed(first_ms: int, speed_m_s: float) -> float:
        for now in range(first_ms, first_ms + 5000, 10):
            drives = measured(config, now, joint_torque_n_m=torque, v_set_m_s=speed_m_s)
            hold.feel(drives, mission)
            told = hold.hold(drives, mission)
        return float(handle_force(posture, told.joint_torque_n_m)[0])

    assert pushed(0, 0.0) == pytest.approx(0.0, abs=0.01)
    assert 6.0 < pushed(5000, 0.2) < 12.0
    assert pushed(10_000, -0.1) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("cause", ["slip", "collision"])
def test_the_supervisor_stops_by_what_the_arms_name(config: Config, cause: str) -> None:
    bench = Bench(config)
    bench.to_approach()
    arms = bench.seen.arms
    assert arms is not None
    bench.step(arms=replace(arms, cause=cause))  # type: ignore[arg-type]
    assert bench.mission is not None
    assert (bench.mission.phase, bench.mission.cause, bench.mission.armed) == ("aborted", cause, False)
    assert bench.mission.grip == "closed"
    assert bench.ask("start").outcome == "refused"


def test_a_rigid_resistance_on_the_approach_ends_it(config: Config) -> None:
    bench = Bench(config)
    bench.to_approach()
    arms = bench.seen.arms
    assert arms is not None
    bench.step(arms=replace(arms, contact=True, connected=True))
    assert bench.mission is not None
    assert (bench.mission.phase, bench.mission.cause) == ("aborted", "contact_early")
