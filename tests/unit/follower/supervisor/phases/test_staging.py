"""Staging: back by odometry, stand, take the trolley that is brought; back with a trolley to try again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from common.config import Config
from common.geometry import Pose2
from common.messages import ArmState, Drives
from follower.supervisor.transitions import next_phase
from tests.rigs.supervisor_rig import ARMS, LEADER, Bench, docking_state

EMPTY = ArmState(0.0, False, False, False, True)
LOCKED = replace(LEADER, lock="locked", queue=1)


@dataclass
class Yard(Bench):
    """A bench whose base moves as commanded, whose grippers open, and where a trolley may be brought."""

    x_m: float = 1.75
    trolley_there: bool = False
    sees: bool = True
    driven_m: float = 0.0

    def live(self, seconds: float, until: str = "") -> str:
        """Let time pass, or until the phase."""
        for _ in range(round(20 * seconds)):
            if self.sequence.phase == until:
                break
            mission = self.mission
            speed = mission.straight_speed_m_s if mission and mission.motion == "straight" else 0.0
            self.x_m -= speed / 20
            self.driven_m += speed / 20
            angle = self.driven_m / self.config.base.wheel_radius_m
            assert self.seen.drives is not None
            drives = replace(
                self.seen.drives,
                wheel_angle_rad=(angle, angle),
                wheel_speed_rad_s=(speed / self.config.base.wheel_radius_m,) * 2,
            )
            self.step(drives=drives, arms=self.arms(), state=docking_state(self.config, self.pose(), self.sees))
        return self.sequence.phase

    def live_until_waiting_for(self, what: str) -> None:
        """Let time pass until the mission waits for it."""
        for _ in range(20 * 60):
            self.live(0.05)
            if self.mission is not None and self.mission.waiting == what:
                return
        pytest.fail(f"never waited for {what}")

    def pose(self) -> Pose2:
        return Pose2(self.x_m, 0.02, 0.01)

    def arms(self) -> ArmState:
        closed = self.mission is None or self.mission.grip == "closed"
        return ARMS if closed and self.trolley_there else replace(EMPTY, released=not closed)


@pytest.fixture
def yard(config: Config) -> Yard:
    made = Yard(config)
    made.seen = replace(made.seen, leader=LOCKED, arms=EMPTY)
    made.live(0.2)
    return made


def test_it_backs_away_stands_open_and_takes_the_trolley_that_is_brought(yard: Yard, config: Config) -> None:
    assert yard.ask("start", trolley=2).outcome == "accepted"
    assert yard.live(19.0) == "staging"
    assert yard.mission is not None
    assert yard.mission.straight_speed_m_s == -config.supervisor.retract_speed_m_s
    yard.live_until_waiting_for("trolley")
    assert yard.mission.motion == "hold"
    wanted = config.docking.goal(2).x_m + config.docking.staging_distance_m
    assert yard.x_m == pytest.approx(wanted, abs=0.03)
    yard.trolley_there = True
    assert yard.live(20.0, until="acquire") == "acquire"
    assert yard.mission.grip == "closed"
    assert yard.live(1.0) == "approach"
    assert yard.mission.trolley == 2


def test_a_weak_battery_stands_on_the_way_back_and_ends_by_name(yard: Yard) -> None:
    assert yard.ask("start", trolley=2).outcome == "accepted"
    yard.live(10.0)
    assert yard.seen.drives is not None
    yard.seen = replace(yard.seen, drives=replace(yard.seen.drives, battery_v=21.9))
    yard.live(1.0)
    assert yard.mission is not None
    assert yard.mission.motion == "hold"
    assert yard.mission.waiting.startswith("battery at 21.9 V")
    assert yard.live(60.0, until="aborted") == "aborted"
    assert yard.mission.cause.startswith("staging_timeout: battery at 21.9 V")


def test_beyond_the_staging_pose_it_stands_where_it_is(yard: Yard) -> None:
    yard.x_m = 5.0
    yard.live(0.2)
    yard.ask("start", trolley=2)
    yard.live(10.0)
    assert yard.x_m == 5.0


def test_a_wrong_number_does_not_send_it_across_the_hall(yard: Yard) -> None:
    yard.seen = replace(yard.seen, leader=replace(LOCKED, queue=21))
    assert yard.ask("start", trolley=22).outcome == "accepted"
    assert yard.live(1.0) == "aborted"
    assert yard.mission is not None
    assert yard.mission.cause.startswith("staging_timeout: 7.6 m back, more than 2.")
    assert yard.mission.cause.endswith("is 22 the right trolley?")
    assert yard.driven_m == 0.0


def test_the_way_back_from_a_docking_that_ended_before_it_backed_away_is_not_too_far(yard: Yard) -> None:
    yard.x_m = yard.config.docking.goal(1).x_m - 0.17
    yard.live(0.5)
    assert yard.ask("start", trolley=2).outcome == "accepted"
    assert yard.live(5.0) == "staging"
    assert yard.driven_m < 0.0


def test_the_way_back_needs_no_leds(yard: Yard, config: Config) -> None:
    yard.ask("start", trolley=2)
    yard.live(2.0)
    yard.sees = False
    yard.live(30.0)
    assert yard.x_m == pytest.approx(config.docking.goal(2).x_m + config.docking.staging_distance_m, abs=0.03)


def test_without_a_trolley_it_ends_by_name_with_open_grippers_ready_for_the_next_try(yard: Yard) -> None:
    yard.ask("start", trolley=2)
    assert yard.live(120.0, until="aborted") == "aborted"
    assert yard.mission is not None
    assert (yard.mission.cause, yard.mission.armed, yard.mission.needs_reset) == ("no_trolley", False, False)
    assert yard.ask("start", trolley=2).outcome == "accepted"


def test_where_it_stands_must_be_known(config: Config) -> None:
    blind = Yard(config, sees=False)
    blind.seen = replace(blind.seen, leader=LOCKED, arms=EMPTY)
    blind.live(0.2)
    blind.ask("start", trolley=2)
    assert blind.live(6.0) == "aborted"
    assert blind.mission is not None
    assert blind.mission.cause == "staging_timeout: the Leader has not been seen yet"


@pytest.mark.parametrize(
    ("leader", "named"),
    [(LEADER, "open, not locked"), (replace(LOCKED, queue=4), "counts 4 trolleys, not 1")],
)
def test_a_queue_that_does_not_fit_keeps_it_from_moving(yard: Yard, leader: object, named: str) -> None:
    yard.seen = replace(yard.seen, leader=leader)  # type: ignore[arg-type]
    yard.ask("start", trolley=2)
    assert yard.live(6.0) == "aborted"
    assert yard.mission is not None
    assert named in yard.mission.cause
    assert yard.x_m == 1.75


def test_an_approach_that_comes_no_nearer_goes_back_and_tries_again_three_times(yard: Yard, config: Config) -> None:
    """The bench's base does not obey the servo: it stands off the goal for ever."""
    yard.trolley_there = True
    yard.x_m = 2.2
    yard.seen = replace(yard.seen, leader=LEADER, arms=ARMS)
    yard.ask("start", trolley=1)
    for _ in range(3):
        assert yard.live(3.0, until="approach") == "approach"
        assert yard.live(config.supervisor.stall_timeout_s + 1.0, until="staging") == "staging"
        assert yard.live(2.5) == "staging"
        assert yard.live(30.0, until="acquire") == "acquire"
        assert yard.x_m == pytest.approx(3.5, abs=0.03)
        yard.x_m = 2.2
        yard.driven_m += 5.0
    assert yard.live(60.0, until="aborted") == "aborted"
    assert yard.mission is not None
    assert yard.mission.cause == "no_progress: 3 retries"


def test_nothing_goes_back_while_it_touches(yard: Yard) -> None:
    yard.x_m = 2.2
    yard.trolley_there = True
    yard.seen = replace(yard.seen, leader=LEADER, arms=ARMS)
    yard.ask("start", trolley=1)
    assert yard.live(3.0, until="approach") == "approach"
    for _ in range(20 * 20):
        yard.step(arms=replace(ARMS, contact=True))
    assert yard.mission is not None
    assert yard.mission.cause.startswith("no_progress: no retry")


def test_a_late_command_on_the_way_back_is_rearmed(yard: Yard) -> None:
    yard.ask("start", trolley=2)
    yard.live(3.0)
    assert yard.mission is not None
    epoch = yard.mission.epoch
    stopped: Drives | None = yard.seen.drives
    assert stopped is not None
    yard.step(drives=replace(stopped, state="stopped", cause="command_age"))
    assert (yard.mission.phase, yard.mission.epoch) == ("staging", epoch + 1)
    yard.seen = replace(yard.seen, drives=replace(stopped, state="disarmed"))
    yard.live(3.0)
    assert yard.mission.motion == "straight"
    assert next_phase("staging", "late") == "staging"
