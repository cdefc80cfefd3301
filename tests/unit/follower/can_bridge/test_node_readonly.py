"""Read-only: the bridge follows a bus on which another master works, and sends nothing whatever is asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from common.canopen.frames import CanFrame
from common.channels import MISSION
from common.messages import Drives
from common.node import Inbox, NodeContext, Outbox
from follower.can_bridge.inbound import Inbound
from follower.can_bridge.node import CanBridgeNode
from follower.can_bridge.robot_axes import make_axes
from tests.rigs.canbus_rig import CONFIG_PATH, Rig, Tap, follower_rig, stepped_config, wheel_surface_speed
from tests.rigs.supervisor_rig import Bench

READONLY = stepped_config("follower_can.readonly=true")


class Listener:
    """A read-only bridge beside the rig's master, which a supervisor asks to arm."""

    def __init__(self, rig: Rig, folder: Path) -> None:
        self.rig = rig
        self.node = CanBridgeNode(NodeContext(READONLY, CONFIG_PATH, folder, 1, rig.clock))
        self.inbox, self.sender = Inbox(rig.clock.boot_id), Outbox("supervisor", 1, rig.clock.boot_id)
        self.mission = replace(Bench(READONLY).step().mission, armed=True, epoch=7)
        self.node.start(rig.clock.now_ns())

    def step(self) -> Drives | None:
        """Receive the mission, step once, send nothing."""
        tap, now_ns = Tap(self.rig), self.rig.clock.now_ns()
        self.inbox.put_state(MISSION, self.sender.pack(MISSION, self.mission, now_ns), now_ns)
        self.inbox.begin_step()
        outputs = self.node.step(now_ns, self.inbox)
        assert tap.read() == []
        tap.close()
        reported = [message for _, message in outputs if isinstance(message, Drives)]
        return reported[0] if reported else None


def test_it_reports_what_another_masters_drives_do(tmp_path: Path) -> None:
    with follower_rig() as rig:
        rig.enable()
        rig.cycles(80, wheel_surface_speed(0.2, rig.config))
        listener = Listener(rig, tmp_path)
        listener.step()
        for _ in range(5):
            rig.cycle(wheel_surface_speed(0.2, rig.config))
            drives = listener.step()
            assert drives is not None
            assert (drives.state, drives.cause, drives.shadow) == ("disarmed", "", True)
        assert drives is not None
        assert drives.wheel_speed_rad_s[0] * rig.config.base.wheel_radius_m == pytest.approx(0.2, rel=1e-3)
        assert drives.stop_inputs_clear
        listener.node.stop(rig.clock.now_ns())
        assert rig.cycle(wheel_surface_speed(0.2, rig.config)).faults == ()


def test_answers_to_a_sync_that_it_missed_are_no_fault() -> None:
    can = READONLY.follower_can
    inbound = Inbound(make_axes(can, READONLY.base), can.io_node_id)
    answers = [CanFrame(0x180 + node_id, bytes(8)) for node_id in (1, 2, 11, 12)] + [CanFrame(0x1A8, bytes(3))]
    for frame in answers:
        inbound.handle_frame(frame, 1, 1)
    assert (inbound.malformed, inbound.faults(1)) == (0, [])
    inbound.synchronised(2)
    for frame in answers * 2:
        inbound.handle_frame(frame, 2, 2)
    assert inbound.malformed == len(answers)


def test_it_warns_that_no_master_is_active(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with follower_rig() as rig:
        listener = Listener(rig, tmp_path)
        for _ in range(5):
            listener.step()
            rig.pass_time(10)
        assert caplog.text.count("no SYNC received yet") == 1
        assert not any(drive.enabled for drive in rig.robot.drives)
