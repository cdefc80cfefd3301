"""A camera or a controller that is late for a moment pauses the approach; it does not end it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from common.channels import DOCK_REQUEST, DRIVES, MISSION
from common.messages import DockRequest, Drives, Mission
from common.node import Inbox, Node, Output, Trigger
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock
from sim.stepped import SteppedExecutor
from tests.rigs.canbus_rig import stepped_config
from tests.rigs.stepped_rig import stepped_nodes

APPROACH_NS = 2 * NS_PER_S


class Silenced(Node):
    """A node whose steps are left out for a while."""

    def __init__(self, node: Node, from_ns: int, to_ns: int) -> None:
        self.name, self.trigger, self.inputs = node.name, node.trigger, node.inputs
        self.outputs, self.serves = node.outputs, node.serves
        self._node, self._from_ns, self._to_ns = node, from_ns, to_ns

    def start(self, now_ns: int) -> None:
        self._node.start(now_ns)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        return () if self._from_ns <= now_ns < self._to_ns else self._node.step(now_ns, inputs)

    def stop(self, now_ns: int) -> Sequence[Output]:
        return self._node.stop(now_ns)


class Watcher(Node):
    """Asks for the docking and keeps missions and drives."""

    name = "watcher"
    inputs = (MISSION, DRIVES)
    trigger = Trigger(period_ns=NS_PER_S // 20, wakes=(MISSION, DRIVES))

    def __init__(self) -> None:
        self.missions: list[Mission] = []
        self.drives: list[tuple[int, Drives]] = []
        self._asked = False

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        mission, drives = inputs.arrived(MISSION), inputs.arrived(DRIVES)
        if mission is not None:
            self.missions.append(mission)
        if drives is not None:
            self.drives.append((now_ns, drives))
        if self._asked or now_ns < 2 * NS_PER_S:
            return ()
        self._asked = True
        return ((DOCK_REQUEST, DockRequest("start", now_ns + NS_PER_S, "start")),)


def approach(runtime: Path, silent: str, gap_ms: float) -> tuple[Watcher, int]:
    """Some seconds of an approach in which one process is silent for a while; when the silence began."""
    config, clock, watcher = stepped_config("world.start=[4.0,0.2,0.0]"), SteppedClock(), Watcher()
    begin_ns = 2 * NS_PER_S + APPROACH_NS
    silence_ns = begin_ns, begin_ns + round(gap_ms * NS_PER_MS)
    nodes = [
        Silenced(node, *silence_ns) if node.name == silent else node for node in stepped_nodes(config, runtime, clock)
    ]
    with SteppedExecutor([*nodes, watcher], clock) as executor:
        executor.run(begin_ns + 5 * NS_PER_S // 2)
    return watcher, begin_ns


@pytest.mark.parametrize("gap_ms", [60, 85, 150, 300, 900])
def test_a_camera_gap_pauses_the_approach_and_it_goes_on(tmp_path: Path, gap_ms: float) -> None:
    watcher, begin_ns = approach(tmp_path, "follower-camera", gap_ms)
    phases = [mission.phase for mission in watcher.missions]
    assert phases[-1] == "approach"
    assert "aborted" not in phases
    assert len({mission.epoch for mission in watcher.missions if mission.armed}) == 1
    during = [d for at, d in watcher.drives if begin_ns + 260 * NS_PER_MS < at < begin_ns + round(gap_ms * NS_PER_MS)]
    assert all(d.v_set_m_s == 0.0 for d in during)
    assert watcher.drives[-1][1].v_set_m_s > 0.0


def test_a_controller_gap_stops_the_wheels_and_the_approach_goes_on_under_a_new_epoch(tmp_path: Path) -> None:
    watcher, begin_ns = approach(tmp_path, "follower-controller", 400)
    during = [d for at, d in watcher.drives if begin_ns + 150 * NS_PER_MS < at < begin_ns + 400 * NS_PER_MS]
    assert during
    assert all(d.v_set_m_s == 0.0 for d in during)
    armed = [mission.epoch for mission in watcher.missions if mission.armed]
    assert armed[-1] == armed[0] + 1
    assert watcher.missions[-1].phase == "approach"
    assert watcher.drives[-1][1].v_set_m_s > 0.0
