"""From docking state and mission to the commanded twist, with a solver whose plan is fixed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.config import Config, load_config
from common.errors import ConfigError
from common.geometry import Pose2, features_at
from common.messages import DockingState, Mission
from common.timing import NS_PER_MS
from follower.controller.davpc import DavpcMethod
from follower.controller.docking import DockingController, Twist
from follower.controller.interface import Goal, Plan, PlanStatus, SpeedCaps
from follower.controller.methods import MODULES, make_method
from follower.controller.replay import MAX_REPLAYED_PLANS
from follower.paper.method import PaperMethod
from tests.rigs.supervisor_rig import Bench, docking_state


class Puppet:
    """A solver with a fixed plan, that remembers what it was asked."""

    def __init__(self) -> None:
        self.status = PlanStatus.SOLVED
        self.asked: list[tuple[Any, ...]] = []

    def warm_up(self) -> None: ...

    def reset(self) -> None: ...

    def solve(self, state: Any, goal: Goal, last_applied: tuple[float, float], caps: SpeedCaps) -> Plan:
        self.asked.append((state, goal, last_applied, caps))
        v = np.linspace(0.10, 0.14, 5)
        return Plan(self.status, v, -v, 0.0, 1, np.zeros((6, 3)))


def controlled(config: Config, puppet: Puppet | None = None) -> DockingController:
    return DockingController(config, DavpcMethod(config, puppet or Puppet()))


def driven(controller: DockingController, state: DockingState | None, mission: Mission) -> float:
    """One step whose twist is published; its speed."""
    twist = controller.step(0, state, mission, None)
    controller.commit(twist)
    return twist.v_m_s


@pytest.fixture
def mission(config: Config) -> Mission:
    bench = Bench(config)
    bench.to_approach()
    assert bench.mission is not None
    return bench.mission


@pytest.fixture
def seen(config: Config) -> DockingState:
    return docking_state(config, Pose2(5.0, 0.1, 0.0))


def test_it_holds_unless_an_armed_mission_wants_motion(config: Config, mission: Mission, seen: DockingState) -> None:
    controller = controlled(config)
    for held in (None, replace(mission, armed=False), replace(mission, motion="hold")):
        twist = controller.step(0, seen, held, None)
        assert (twist.v_m_s, twist.w_rad_s) == (0.0, 0.0)


def test_caps_of_the_mission_lower_those_of_the_configuration(
    config: Config, mission: Mission, seen: DockingState
) -> None:
    puppet = Puppet()
    controller = controlled(config, puppet)
    controller.step(0, seen, replace(mission, v_max_m_s=0.07, w_max_rad_s=1.9), None)
    caps = puppet.asked[0][3]
    assert (caps.v_max_m_s, caps.w_max_rad_s) == (0.07, config.limits.w_max_rad_s)


def test_it_plans_from_where_the_command_takes_effect(config: Config, mission: Mission, seen: DockingState) -> None:
    puppet = Puppet()
    controlled(config, puppet).step(30 * NS_PER_MS, seen, mission, (0.4, 0.0))
    ahead_s = max(0.030, config.base.latency_ms / 1000)
    assert puppet.asked[0][0].leader_in_follower.x_m == pytest.approx(5.0 - 0.4 * ahead_s)


def test_a_failed_plan_is_bridged_by_the_last_one_for_two_periods(
    config: Config, mission: Mission, seen: DockingState
) -> None:
    puppet = Puppet()
    controller = controlled(config, puppet)
    controller.commit(Twist(0.09, -0.09, ""))
    assert driven(controller, seen, mission) == pytest.approx(0.10)
    puppet.status = PlanStatus.INFEASIBLE
    bridged = [driven(controller, seen, mission) for _ in range(MAX_REPLAYED_PLANS + 2)]
    assert bridged == pytest.approx([0.11, 0.12, 0.0, 0.0])


def test_a_gap_of_states_is_bridged_and_then_held(config: Config, mission: Mission, seen: DockingState) -> None:
    controller = controlled(config)
    controller.commit(Twist(0.09, -0.09, ""))
    driven(controller, seen, mission)
    assert [driven(controller, None, mission) for _ in range(3)] == pytest.approx([0.11, 0.12, 0.0])
    assert controller.step(0, seen, mission, None).source == "solved"


def test_straight_motion_keeps_the_rate_limit(config: Config, mission: Mission, seen: DockingState) -> None:
    controller = controlled(config)
    straight = replace(mission, motion="straight", straight_speed_m_s=0.05)
    controller.commit(Twist(0.0, 0.2, ""))
    speeds = [driven(controller, seen, straight) for _ in range(4)]
    assert speeds == pytest.approx([0.02, 0.04, 0.05, 0.05])


def test_straight_motion_stops_without_a_state_and_forwards_without_a_valid_one(
    config: Config, mission: Mission, seen: DockingState
) -> None:
    lost = replace(seen, valid=False, cause="few_leds")
    for speed, state, moves in ((0.05, None, False), (-0.1, None, False), (0.05, lost, False), (-0.1, lost, True)):
        controller = controlled(config)
        twist = controller.step(0, state, replace(mission, motion="straight", straight_speed_m_s=speed), None)
        assert (twist.v_m_s != 0.0) == moves


def test_a_turn_ends_within_the_rate_limit_too(config: Config, mission: Mission, seen: DockingState) -> None:
    controller = controlled(config)
    controller.commit(Twist(0.05, 0.2, ""))
    straight = replace(mission, motion="straight", straight_speed_m_s=0.05, w_max_rad_s=0.0)
    assert controller.step(0, seen, straight, None).w_rad_s == pytest.approx(0.12)


def test_what_was_not_published_does_not_count(config: Config, mission: Mission, seen: DockingState) -> None:
    controller = controlled(config)
    straight = replace(mission, motion="straight", straight_speed_m_s=0.05)
    for _ in range(3):
        late = controller.step(0, seen, straight, None)
    assert late.v_m_s == pytest.approx(config.limits.controller_dv_m_s)


def test_a_bridging_plan_keeps_caps_that_were_lowered_meanwhile(
    config: Config, mission: Mission, seen: DockingState
) -> None:
    controller = controlled(config)
    controller.commit(Twist(0.09, -0.09, ""))
    driven(controller, seen, mission)
    slow = replace(mission, v_max_m_s=0.05, w_max_rad_s=0.05)
    twist = controller.step(0, None, slow, None)
    assert (twist.v_m_s, twist.w_rad_s) == pytest.approx((0.08, -0.05))


def test_the_papers_method_compensates_what_its_observer_sees_within_the_rate_limit(
    config_path: Path, config: Config, mission: Mission
) -> None:
    paper = load_config(config_path, ["controller.method='paper_fatrop'"])
    puppet = Puppet()
    controller = DockingController(paper, PaperMethod(paper, puppet))
    controller.step(0, docking_state(config, Pose2(3.0, 0.0, 0.0)), replace(mission, motion="hold"), None)
    # features that run away although nothing is commanded: a disturbance, as if something pulled the robot back
    for n in range(120):
        pose = Pose2(3.0 + 0.002 * n, 0.0, 0.0)
        features = features_at(paper.leds.points, pose, paper.camera.mount)
        state = replace(
            docking_state(config, pose),
            features=tuple((float(a), float(b)) for a, b in features),
            theta_homography_rad=0.0,
            capture_ns=n * 16_666_667,
        )
        controller.observe(state, None)
    twist = controller.step(0, state, mission, None)
    assert twist.source == "compensated"
    assert twist.v_m_s == pytest.approx(paper.limits.controller_dv_m_s)
    assert puppet.asked[-1][0].theta_rad == pytest.approx(0.0)


def test_every_method_can_be_made_and_no_other_is_accepted(config_path: Path) -> None:
    for name in MODULES:
        made = make_method(load_config(config_path, [f"controller.method='{name}'"]))
        assert isinstance(made, DavpcMethod if name == "davpc" else PaperMethod)
    with pytest.raises(ConfigError, match=r"controller\.method: .*'paper_fatrop'.* got 'paper'"):
        load_config(config_path, ["controller.method='paper'"])


def test_the_key_that_methods_replaced_is_named(config_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"controller\.solver: unknown key: controller\.method chooses it"):
        load_config(config_path, ["controller.solver='fatrop'"])


_MAKE = """
import sys
from pathlib import Path
from common.config import default_config_path, load_config
from common.node import NodeContext
from common.timing import SteppedClock
from follower.{room}.node import make
config = load_config(default_config_path())
node = make(NodeContext(config, Path("robots.toml"), Path(sys.argv[1]), 1, SteppedClock(0)))
node.start(0)
print([name for name in sys.modules if name.split(".")[0] == "casadi" or name.startswith("follower.paper")])
"""


@pytest.mark.parametrize("room", ["controller", "estimator", "supervisor"])
def test_the_default_method_loads_nothing_of_the_papers(room: str, tmp_path: Path) -> None:
    script = _MAKE.format(room=room)
    answer = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=60, check=True
    )
    assert answer.stdout.strip() == "[]"
