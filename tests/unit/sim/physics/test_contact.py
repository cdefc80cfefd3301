"""Simulated arms, trolley and guide; the arms' own code holding a trolley in a closed loop."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import Config
from common.errors import ConfigError
from common.geometry import Pose2
from experiments.contact.experiment import ContactJob, push_job, run
from experiments.contact.handle_bench import BenchMotor, ContactBench, Sample
from sim.physics.arm import SimulatedArms
from sim.physics.contact import Contact
from sim.physics.trolley import RubberPad
from sim.world_config import WorldConfig, world_config

DT_S = 0.002


@pytest.fixture(scope="module")
def world(config: Config) -> WorldConfig:
    return world_config(config, "test")


def loaded(world: WorldConfig, mass_kg: float, **changes: float) -> WorldConfig:
    return world.model_copy(update={"trolley_mass_kg": mass_kg, **changes})


def make_arms(config: Config, world: WorldConfig) -> tuple[SimulatedArms, tuple[BenchMotor, ...]]:
    joints = tuple(BenchMotor() for _ in range(6))
    grippers, lift = (BenchMotor(), BenchMotor()), BenchMotor("position")
    lift.position_setpoint = config.arms.lift_height_m
    return SimulatedArms(config.arms, world, joints, grippers, lift), (*joints, *grippers, lift)


def run_for(bench: ContactBench, seconds: float, speed: Callable[[float], float], push: bool = False) -> list[Sample]:
    return [bench.cycle(speed(i / 100), push) for i in range(round(seconds * 100))]


# --- trolley and guide


def coast(contact: Contact, seconds: float, force_n: float = 0.0) -> None:
    for _ in range(round(seconds / DT_S)):
        contact.advance((force_n, 0.0), 0.0, 0.06, DT_S)


def test_a_rolling_trolley_stops_and_stays(world: WorldConfig) -> None:
    contact = Contact(world, Pose2(-5.0, 0.3, 0.2), velocity=(0.3, -0.2, 0.3))
    coast(contact, 4.0)
    stopped = contact.handle
    assert contact.velocity == (0.0, 0.0, 0.0)
    coast(contact, 1.0, force_n=0.9 * world.rolling_resistance * world.trolley_mass_kg * 9.81)
    assert contact.handle == stopped


def test_a_force_accelerates_it_as_its_mass_says(world: WorldConfig) -> None:
    smooth = loaded(world, 20.0, rolling_resistance=0.0)
    contact = Contact(smooth, Pose2(-5.0, 0.0, 0.0))
    coast(contact, 1.0, force_n=4.0)
    assert contact.velocity[0] == pytest.approx(0.2)
    assert contact.handle.x_m == pytest.approx(-4.9, abs=1e-3)


def test_the_guide_is_lifted_then_holds_the_beam(world: WorldConfig) -> None:
    contact = Contact(world, Pose2(-0.15 - world.handle_to_beam_m, 0.0, 0.0))
    lifted = False
    while not contact.seated:
        coast(contact, DT_S, force_n=50.0)
        lifted = lifted or contact.lifted
    coast(contact, 1.0, force_n=100.0)
    assert lifted
    assert not contact.lifted
    assert 0.0 < contact.beam_x_m < 0.006
    coast(contact, 1.0, force_n=-100.0)
    assert -0.01 < contact.beam_x_m < 0.0


def test_a_beam_beside_the_guide_is_never_seated(world: WorldConfig) -> None:
    contact = Contact(world, Pose2(-0.15 - world.handle_to_beam_m, 0.08, 0.0))
    coast(contact, 3.0, force_n=60.0)
    assert not contact.seated
    assert contact.beam_x_m == pytest.approx(world.guide_ramp_m[0], abs=0.005)


@settings(max_examples=10)
@given(height=st.floats(0.001, 0.01))
def test_a_pad_gives_back_at_its_far_edge_what_climbing_took(height: float) -> None:
    pad = RubberPad(0.0, 0.5, height, rolling_resistance=0.0)
    places = np.linspace(-0.1, 0.7, 8_001)
    force = np.array([pad.resistance(float(x)) for x in places])
    climbing = np.sum(force[places < 0.2]) * (places[1] - places[0])
    assert climbing == pytest.approx(height, rel=0.05)
    assert np.sum(force) == pytest.approx(0.0, abs=0.5)


# --- simulated arms


def test_free_arms_rest_against_friction_and_move_beyond_it(config: Config, world: WorldConfig) -> None:
    arms, motors = make_arms(config, world)
    for gripper in arms.grippers:
        gripper.hold, gripper.angle_rad = None, 1.2
    start = motors[0].angle_rad
    for torque, moves in ((0.9 * world.joint_friction_n_m, False), (2.0 * world.joint_friction_n_m, True)):
        motors[0].torque_setpoint_n_m = torque
        for _ in range(200):
            arms.advance(Pose2(3.0, 0.0, 0.0), (0.0, 0.0, 0.0), DT_S)
        assert (abs(motors[0].angle_rad - start) > 0.01) is moves


def test_a_joint_stops_at_its_limit(config: Config, world: WorldConfig) -> None:
    arms, motors = make_arms(config, world)
    for gripper in arms.grippers:
        gripper.hold = None
    for motor in motors[:6]:
        motor.torque_setpoint_n_m = 8.0
    for _ in range(1500):
        arms.advance(Pose2(3.0, 0.0, 0.0), (0.0, 0.0, 0.0), DT_S)
    limits = [np.radians(high) for _, high in config.arms.joint_limits_deg]
    assert [motor.angle_rad for motor in motors[:3]] == pytest.approx(limits)


def test_action_and_reaction_balance_at_the_handle(config: Config, world: WorldConfig) -> None:
    arms, motors = make_arms(config, world)
    for motor in motors[:6]:
        motor.effort = "position"
        motor.position_setpoint = motor.angle_rad
    for _ in range(500):
        force = arms.advance(Pose2(world.handle_x_m - 0.004, 0.0, 0.0), (0.0, 0.0, 0.0), DT_S)
    assert force[0] > 20.0
    assert force[1:] == pytest.approx((0.0, 0.0), abs=0.5)


def test_measured_torques_carry_noise_and_none_without_power(config: Config, world: WorldConfig) -> None:
    arms, motors = make_arms(config, world)
    felt = []
    for _ in range(500):
        arms.advance(Pose2(world.handle_x_m, 0.0, 0.0), (0.0, 0.0, 0.0), DT_S)
        felt.append(motors[1].torque_n_m)
    assert np.std(felt) == pytest.approx(world.torque_noise_n_m, rel=0.3)
    motors[1].effort = "none"
    arms.advance(Pose2(world.handle_x_m, 0.0, 0.0), (0.0, 0.0, 0.0), DT_S)
    assert motors[1].torque_n_m == 0.0


def test_a_handle_that_the_simulated_arms_cannot_reach_is_an_error_of_the_configuration(
    config: Config, world: WorldConfig
) -> None:
    with pytest.raises(ConfigError, match=r"world\.handle_x_m"):
        make_arms(config, world.model_copy(update={"handle_x_m": 0.9}))


def test_fingers_open_close_on_the_handle_and_on_nothing(config: Config, world: WorldConfig) -> None:
    arms, motors = make_arms(config, world)

    def squeeze(torque: float, handle: Pose2) -> float:
        for motor in motors[6:8]:
            motor.torque_setpoint_n_m = torque
        for _ in range(500):
            arms.advance(handle, (0.0, 0.0, 0.0), DT_S)
        return motors[6].angle_rad

    there, away = Pose2(world.handle_x_m, 0.0, 0.0), Pose2(2.0, 0.0, 0.0)
    assert squeeze(-1.5, there) > config.arms.grip_open_rad
    assert not arms.holding
    assert config.arms.grip_empty_rad < squeeze(3.0, there) < config.arms.grip_closed_rad
    assert arms.holding
    squeeze(-1.5, there)
    assert squeeze(3.0, away) < config.arms.grip_empty_rad
    assert not arms.holding


# --- closed loop


@pytest.mark.parametrize("mass_kg", [15.0, 35.0])
def test_the_holding_posture_holds_a_trolley_at_rest_and_after_a_start_and_a_stop(
    config: Config, world: WorldConfig, mass_kg: float
) -> None:
    bench = ContactBench(config, loaded(world, mass_kg), -3.0)
    run_for(bench, 4.0, lambda t: 0.3 if t < 2.0 else 0.0)
    resting = bench.contact.handle.x_m
    last = run_for(bench, 1.0, lambda _: 0.0)
    handle = bench.contact.handle.x_m - bench.robot_x_m
    assert abs(bench.contact.handle.x_m - resting) < 1e-3
    assert handle == pytest.approx(config.arms.handle_x_m, abs=0.004)
    assert abs(bench.contact.handle.theta_rad) < 0.02
    assert all(sample.state.gripped and sample.state.cause == "ok" for sample in last)


@settings(max_examples=5)
@given(mass=st.floats(15, 35), speed=st.floats(0.05, 0.5), friction=st.floats(0.1, 0.5))
def test_driving_off_is_neither_contact_nor_collision(
    config: Config, world: WorldConfig, mass: float, speed: float, friction: float
) -> None:
    bench = ContactBench(config, loaded(world, mass, joint_friction_n_m=friction), -3.0)
    for sample in run_for(bench, 2.0, lambda _: speed):
        assert (sample.state.contact, sample.state.connected, sample.state.cause) == (False, False, "ok")


@pytest.mark.parametrize("speed", [0.22, 0.3])
def test_driving_into_a_wall_is_a_collision_and_the_arms_yield(
    config: Config, world: WorldConfig, speed: float
) -> None:
    beside = 2 * config.docking.lateral_bound_first_m
    bench = ContactBench(config, world, -0.8, lateral_m=beside)
    samples = run_for(bench, 6.0, lambda _: 0.0 if bench.contact.beam_x_m > -0.101 else speed)
    hit = next(i for i, sample in enumerate(samples) if sample.beam_x_m >= -0.1)
    detected = next(i for i, sample in enumerate(samples) if sample.state.cause == "collision")
    assert 0 <= detected - hit <= 20
    # no push-back: soon after, the arms press no more than their friction does
    assert max(abs(sample.handle_force_n) for sample in samples[detected + 20 :]) < 40.0


def test_a_trolley_that_slips_is_named(config: Config, world: WorldConfig) -> None:
    bench = ContactBench(config, world, -3.0)
    assert all(sample.state.cause == "ok" for sample in run_for(bench, 1.0, lambda _: 0.1))
    bench.arms.make_slippery(1)
    samples = run_for(bench, 0.2, lambda _: 0.1)
    assert samples[-1].state.cause == "slip"
    assert not samples[-1].state.gripped


def test_a_trolley_that_is_held_back_slips_out_of_weak_fingers(config: Config, world: WorldConfig) -> None:
    strong = ContactBench(config, world, -3.0)
    weak = ContactBench(config, loaded(world, 15.0, finger_friction_n_per_n_m=0.5), -3.0)
    for bench, expected in ((strong, "ok"), (weak, "slip")):
        run_for(bench, 1.5, lambda _: 0.3)
        assert run_for(bench, 1.0, lambda _: -0.05)[-1].state.cause == expected


@pytest.mark.parametrize("after_s", [0.0, 1.0])
def test_an_arm_that_jumps_as_it_loses_its_load_is_a_slip_and_no_collision(
    config: Config, world: WorldConfig, after_s: float
) -> None:
    bench = ContactBench(config, loaded(world, 35.0), -3.0)
    run_for(bench, after_s + 0.15, lambda _: 0.5)
    bench.arms.make_slippery(0)
    assert {sample.state.cause for sample in run_for(bench, 1.0, lambda _: 0.5)} <= {"ok", "slip"}


def test_released_arms_let_go_without_a_jump_and_move_away(config: Config, world: WorldConfig) -> None:
    bench = ContactBench(config, world, -0.12)
    samples = run_for(bench, 5.0, lambda _: 0.05 if not bench.contact.seated else 0.01, push=True)
    assert samples[-1].seated
    held = bench.contact.handle.x_m
    for _ in range(300):
        last = bench.cycle(0.0, contact_expected=False, grip="open")
    assert last.state.released
    assert not bench.contact.gripped
    assert abs(bench.contact.handle.x_m - held) < 0.01


def test_the_campaign_recognises_every_contact_and_no_pad(config: Config, tmp_path: Path) -> None:
    results = run(tmp_path, seed=3, trials=3, config=config)
    job = ContactJob("push", 1, 3, config.model_dump_json())
    assert push_job(job) == push_job(job)
    push, approach = results["rows"]
    assert (push["metrics"]["recognised"], push["metrics"]["early"]) == (3.0, 0.0)
    assert approach["metrics"]["false_contacts"] == 0.0
    assert json.loads((tmp_path / "results.json").read_text())["rows"] == results["rows"]
    assert (tmp_path / "contact.png").stat().st_size > 10_000
    assert "approach over pads" in (tmp_path / "table.md").read_text()
