"""Moving the robot by hand in stepped time: world, bridge, arms and supervisor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from common.channels import COMMAND, DOCK_REQUEST, DRIVES, MANUAL_REQUEST, MISSION
from common.messages import (
    Command,
    Drives,
    ManualRequest,
    Mission,
    seal_command,
)
from common.node import Inbox, Node, Output, Trigger
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock
from sim.stepped import SteppedExecutor
from tests.rigs.canbus_rig import stepped_config
from tests.rigs.stepped_rig import stepped_nodes


class Operator(Node):
    """A station in stepped time: asks, commands while ``until_ns`` has not come, then dies without a word."""

    name = "operator"
    inputs = (MISSION, DRIVES)
    outputs = (COMMAND, MANUAL_REQUEST, DOCK_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 50)

    def __init__(self, twist: tuple[float, float], until_ns: int, **fields: Any) -> None:
        self.twist, self.until_ns, self.fields = twist, until_ns, fields
        self.missions: list[Mission] = []
        self.drives: list[Drives] = []
        self._sequence = 0

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        drives, mission = inputs.fresh(DRIVES, now_ns), inputs.fresh(MISSION, now_ns)
        if drives is None or mission is None:
            return ()
        self.drives.append(drives)
        self.missions.append(mission)
        self._sequence += 1
        if self._sequence == 1:
            return ((MANUAL_REQUEST, ManualRequest("by-hand", now_ns + NS_PER_S, "start", **self.fields)),)
        if mission.phase != "manual" or now_ns >= self.until_ns:
            return ()
        command = Command(*self.twist, mission.epoch, self._sequence, now_ns, now_ns + 100 * NS_PER_MS, 0, now_ns)
        return ((COMMAND, seal_command(command)),)


def by_hand(runtime: Path, operator: Operator, seconds: float, *overrides: str) -> Operator:
    """World, bridge, arms and supervisor in stepped time: neither camera nor controller is needed."""
    names = ("world", "follower-can-bridge", "follower-arms", "follower-supervisor")
    clock, config = SteppedClock(), stepped_config(*overrides)
    nodes = stepped_nodes(config, runtime, clock, names)
    with SteppedExecutor([*nodes, operator], clock) as executor:
        executor.run(clock.now_ns() + round(seconds * NS_PER_S))
    return operator


def test_jogging_goes_through_the_gate_and_ends_with_the_station(tmp_path: Path) -> None:
    operator = by_hand(tmp_path, Operator((9.0, 0.0), 4 * NS_PER_S), 6.0)
    fastest = max(drives.v_set_m_s for drives in operator.drives)
    assert fastest == pytest.approx(0.10)
    last = operator.drives[-1]
    assert last.wheel_angle_rad[0] * 0.085 > 0.15
    assert (last.v_set_m_s, operator.missions[-1].phase) == (0.0, "idle")
    assert operator.missions[-1].cause in ("manual: gate_stop: command_age", "manual: gate_stop: valid_until")
    assert last.state in ("stopped", "disarmed")
    assert last.lift_m == pytest.approx(operator.drives[0].lift_m, abs=1e-3)
    assert max(last.grip_angle_rad) < 0.3


def test_lift_and_fingers_move_and_nothing_else(tmp_path: Path) -> None:
    operator = by_hand(tmp_path, Operator((0.0, 0.0), 9 * NS_PER_S, grip="open", lift_m=0.15), 4.0)
    last = operator.drives[-1]
    assert last.lift_m == pytest.approx(0.15, abs=1e-3)
    assert min(last.grip_angle_rad) > 1.0
    assert last.v_set_m_s == 0.0
    assert last.joint_angle_rad == pytest.approx(operator.drives[0].joint_angle_rad, abs=0.15)


def test_in_shadow_everything_is_logged_and_nothing_moves(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    operator = by_hand(tmp_path, Operator((0.08, 0.0), 9 * NS_PER_S, lift_m=0.1), 4.0, "follower_can.shadow=true")
    armed = [drives for drives in operator.drives if drives.state == "armed"]
    assert armed[-1].v_set_m_s == pytest.approx(0.08)
    assert all(drives.shadow for drives in operator.drives)
    assert {drives.wheel_speed_rad_s for drives in operator.drives} == {(0.0, 0.0)}
    assert {drives.lift_m for drives in operator.drives} == {operator.drives[0].lift_m}
    assert operator.missions[-1].phase == "manual"
    assert "shadow: would command v +0.080 m/s" in caplog.text
