"""Trolleys that nest: what meets the one that is pushed, how the next one comes, what guide, bolt and switches do."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from common.config import Config, default_config_path
from common.errors import ConfigError
from common.geometry import Pose2
from sim.can.nodes import LeaderBus
from sim.physics.contact import TROLLEY_PITCH_M, Contact
from sim.physics.leader_plant import LeaderPlant
from sim.physics.trolley import Trolley
from sim.world_config import WorldConfig, world_config

DT_S = 0.002
BOUND_M = 0.10


@pytest.fixture(scope="module")
def world(config: Config) -> WorldConfig:
    return world_config(config, "test")


def queued(
    world: WorldConfig, docked: int, before_m: float = 0.15, y_m: float = 0.0, play_m: float = 0.02
) -> Contact:
    """A trolley whose beam stands ``before_m`` before its place in a queue of ``docked``."""
    changed = world.model_copy(update={"docked": docked, "nest_play_m": play_m, "docked_error_m": 0.0})
    beam = -TROLLEY_PITCH_M * docked - before_m
    return Contact(changed, Pose2(beam - world.handle_to_beam_m, y_m, 0.0))


def push(contact: Contact, speed_m_s: float, seconds: float, bound_m: float = BOUND_M) -> float:
    """Push at a speed, as stiffly as the arms; the greatest force that it took [N]."""
    handle, greatest = contact.handle.x_m, 0.0
    for _ in range(round(seconds / DT_S)):
        handle += speed_m_s * DT_S
        force = 3_000.0 * (handle - contact.handle.x_m) + 350.0 * (speed_m_s - contact.handle_velocity()[0])
        greatest = max(greatest, force)
        contact.advance((force, 0.0), 0.0, bound_m, DT_S)
    return greatest


def test_an_open_queue_is_pushed_shut_before_it_resists_rigidly(world: WorldConfig) -> None:
    contact = queued(world, 4, play_m=0.02)
    members = contact.queue.members
    gaps = [a.beam_x_m - b.beam_x_m - TROLLEY_PITCH_M for a, b in pairwise(members)]
    assert all(0.0 <= gap <= 0.02 for gap in gaps)
    assert sum(gaps) > 0.01
    last_m = contact.queue.mouth_x_m()
    softly_n = push(contact, 0.05, 0.14 / 0.05)
    assert contact.queue.mouth_x_m() > last_m + 0.005  # it gave way
    rigidly_n = push(contact, 0.05, 2.5)
    assert rigidly_n > 150.0
    assert softly_n < 80.0
    shut = [a.beam_x_m - b.beam_x_m - TROLLEY_PITCH_M for a, b in pairwise(members)]
    assert max(map(abs, shut)) < 0.003
    assert contact.home
    assert contact.beam_x_m == pytest.approx(-4 * TROLLEY_PITCH_M, abs=0.025)


def test_the_guide_feels_the_queue_only_through_the_first_trolley(world: WorldConfig) -> None:
    contact = queued(world, 3, play_m=0.0)
    assert contact.seated
    push(contact, 0.05, 3.6)
    assert contact.seated
    assert not contact.lifted
    assert 0.0 <= contact.queue.members[0].beam_x_m < 0.006


@pytest.mark.parametrize("docked", [0, 3])
def test_beyond_its_bound_a_beam_catches(world: WorldConfig, docked: int) -> None:
    bound = 0.06 if docked == 0 else 0.10
    for off_m, passes in ((bound - 0.005, True), (bound + 0.005, False)):
        contact = queued(world, docked, y_m=off_m, play_m=0.0)
        push(contact, 0.05, 4.0, bound)
        assert contact.home is passes


def test_the_next_trolley_stands_before_the_grippers_within_its_error(world: WorldConfig) -> None:
    seen = set()
    for seed in range(20):
        contact = Contact(world.model_copy(update={"seed": seed}), Pose2(-world.handle_to_beam_m, 0.0, 0.0))
        follower_in_leader = Pose2(-4.0, 0.03, 0.02)
        contact.place_next(follower_in_leader, 0.45)
        place = follower_in_leader.inverse().compose(contact.handle)
        e_x, e_y, e_theta = world.place_error
        assert abs(place.x_m - 0.45) <= e_x
        assert abs(place.y_m) <= e_y
        assert abs(place.theta_rad) <= e_theta
        assert len(contact.queue) == 1
        seen.add(round(place.x_m, 6))
    assert len(seen) == 20


def test_a_load_makes_it_heavier_and_is_the_same_for_a_seed(world: WorldConfig) -> None:
    loaded = world.model_copy(update={"trolley_load_kg": 20.0, "docked": 5})
    masses = [[m.mass_kg for m in Contact(loaded, Pose2(-5.0, 0.0, 0.0)).queue.members] for _ in range(2)]
    assert masses[0] == masses[1]
    assert len(set(masses[0])) == 5
    assert all(world.trolley_mass_kg <= mass <= world.trolley_mass_kg + 20.0 for mass in masses[0])


def test_casters_swing_round_and_push_until_they_have(world: WorldConfig) -> None:
    free = world.model_copy(update={"rolling_resistance": 0.0})
    trolley = Trolley(free, Pose2(-5.0, 0.0, 0.0), 15.0, (0.1, 0.0, 0.0), [1.0, 1.0])
    sideways = []
    for _ in range(round(4.0 / DT_S)):
        trolley.advance((2.0, 0.0), 0.0, 0.0, (), DT_S)
        sideways.append(abs(trolley.velocity[1]))
    assert max(sideways) > 0.005
    v_x, v_y, _ = trolley.velocity
    direction = math.atan2(v_y, v_x) - trolley.handle.theta_rad
    assert all(abs(angle - direction) < 0.1 for angle in trolley.casters_rad)
    assert math.hypot(v_x, v_y) > 0.2


def test_a_trolley_that_would_stand_in_the_queue_is_a_mistake(config: Config) -> None:
    crowded = config.model_copy(update={"world": {**config.world, "docked": 8, "start": (3.0, 0.0, 0.0)}})
    with pytest.raises(ConfigError, match="would overlap the queue of 8"):
        world_config(crowded, "here.toml")


# --- the Leader's end


@pytest.fixture
def leader(config: Config) -> LeaderBus:
    return LeaderBus.build(config.leader_can, default_config_path())


def leader_plant(world: WorldConfig, leader: LeaderBus, seated: bool = True) -> LeaderPlant:
    guide = queued(world, 1 if seated else 0).queue.guide
    plant = LeaderPlant(world, leader, 4, guide, DT_S)
    plant.travel = 0.0
    return plant


def run_bolt(plant: LeaderPlant, leader: LeaderBus, direction: int, seconds: float) -> None:
    leader.io.values[0x6200, 1] = {1: 0b01, -1: 0b10, 0: 0}[direction]
    for _ in range(round(seconds / DT_S)):
        plant.listen()
        plant.step(DT_S)
    plant.report()


def switches(leader: LeaderBus) -> tuple[bool, ...]:
    return tuple(bool(leader.io.values[0x6000, 1] >> bit & 1) for bit in range(4))


def test_the_bolt_travels_to_its_switch_and_back(world: WorldConfig, leader: LeaderBus) -> None:
    plant = leader_plant(world, leader)
    run_bolt(plant, leader, 1, world.lock_travel_s + 0.1)
    assert plant.locked
    assert switches(leader) == (False, True, True, False)
    run_bolt(plant, leader, -1, world.lock_travel_s + 0.1)
    assert not plant.locked
    assert switches(leader) == (False, True, False, True)


def test_without_a_beam_or_blocked_it_jams_and_draws_its_limit(world: WorldConfig, leader: LeaderBus) -> None:
    for seated, blocked in ((False, False), (True, True)):
        plant = leader_plant(world, leader, seated)
        plant.faults.bolt_blocked = blocked
        run_bolt(plant, leader, 1, world.lock_travel_s + 0.1)
        assert not plant.locked
        assert leader.io.values[0x6401, 5] > 4000
        run_bolt(plant, leader, -1, world.lock_travel_s + 0.1)
        assert plant.travel == 0.0


def test_a_stuck_switch_a_dead_led_and_no_power(world: WorldConfig, leader: LeaderBus) -> None:
    plant = leader_plant(world, leader)
    for led in range(4):
        leader.io.values[0x6411, led + 1] = 1000
    plant.faults.stuck["lock_extended"] = False
    plant.faults.dead_leds.add(2)
    run_bolt(plant, leader, 1, world.lock_travel_s + 0.1)
    assert plant.locked
    assert switches(leader)[2] is False
    assert [round(current, 2) for current in plant.led_current_a] == [1.0, 1.0, 0.0, 1.0]
    plant.faults.powered = False
    run_bolt(plant, leader, -1, 1.0)
    assert plant.locked
    assert max(plant.led_current_a) < 0.01
