"""Mutated CAN frames into the bridge: nothing is raised, and nothing beyond a limit leaves it."""

from __future__ import annotations

import gc
import os
from pathlib import Path
from random import Random

import pytest

from common.canopen.frames import CanFrame
from common.messages import Command, seal_command
from common.timing import NS_PER_MS
from follower.can_bridge.gate import ArmToken, Gate, StampedCommand
from follower.can_bridge.measurement import DriveSetpoint
from tests.rigs.canbus_rig import Rig, Tap, follower_rig, stop_inputs, wheels_alone

SHARDS = 4
FRAMES = int(os.environ.get("FUZZ_FRAMES", "60000")) // SHARDS
"""`make prove` sends the million; one `make test` a part of it."""


def _mutated(random: Random, genuine: CanFrame) -> CanFrame:
    """A genuine frame with a bit, its length, its identifier or everything changed."""
    can_id, data = genuine.can_id, bytearray(genuine.data)
    match random.randrange(6):
        case 0 if data:
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        case 1:
            data = data[: random.randrange(9)]
        case 2:
            data = bytearray((*data, *random.randbytes(8)))[: random.randrange(9)]
        case 3:
            can_id ^= 1 << random.randrange(11)
        case 4:
            can_id = random.randrange(0x800)
        case 5:
            data = bytearray(random.randbytes(random.randrange(9)))
    return CanFrame(can_id, bytes(data))


def _limits_hold(rig: Rig) -> bool:
    """Whether the drives' last set-points are within what gate and drives may let through."""
    robot, radius = rig.robot, rig.config.base.wheel_radius_m
    surfaces = (abs(wheel.velocity_setpoint_rad_s) * radius for wheel in (robot.left_wheel, robot.right_wheel))
    sent = (abs(wheel.values[0x60FF, 0]) / 208_600 * radius for wheel in (robot.left_wheel, robot.right_wheel))
    torques = (abs(joint.values[0x6071, 0]) for joint in robot.joints)
    return max(*surfaces, *sent) <= 0.6 and max(torques) <= 1000


class _Session:
    """A bridge that is re-armed whenever something stopped it."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.gate = Gate(rig.config.limits, rig.config.base, "boot")
        self.epoch = self.sequence = 1
        self.measured = rig.enable()
        self.moving = 0

    def step(self) -> None:
        """Gate, exchange, 10 ms; then what supervisor and operator would do."""
        rig, measured = self.rig, self.measured
        now_ns, base = rig.clock.now_ns(), rig.config.base
        self.sequence += 1
        fields = (0.5, 0.3, self.epoch, self.sequence, now_ns, now_ns + 120 * NS_PER_MS, 1, now_ns)
        decision = self.gate.step(
            now_ns,
            StampedCommand(command=seal_command(Command(*fields)), run_id=1, boot_id="boot"),
            ArmToken(
                armed=True,
                stamp_ns=now_ns,
                boot_id="boot",
                epoch=self.epoch,
                phase="approach",
                v_max_m_s=0.5,
                w_max_rad_s=0.6,
            ),
            wheels_alone(measured),
            stop_inputs(measured),
        )
        self.moving += decision.v_m_s > 0.0
        turn = decision.w_rad_s * base.track_m / 2
        left, right = ((decision.v_m_s + side * turn) / base.wheel_radius_m for side in (-1, 1))
        self.measured = rig.cycle(DriveSetpoint(left_rad_s=left, right_rad_s=right, joint_torque_n_m=(50.0,) * 6))
        if decision.rule:
            self.epoch += 1
        if not self.measured.bus_ok:
            rig.drives.open()
        elif self.measured.troubles:
            rig.drives.reset_faults()
        else:
            rig.drives.enable()


@pytest.mark.parametrize("seed", range(SHARDS))
def test_mutated_frames_neither_crash_it_nor_get_through(seed: int) -> None:
    random = Random(seed)
    with follower_rig() as rig:
        session, tap = _Session(rig), Tap(rig)
        session.step()
        genuine = [frame for _, frame in tap.read()]
        tap.close()
        sent, before_bytes = 0, 0
        while sent < FRAMES:
            if not before_bytes and sent > FRAMES // 4:
                before_bytes = _resident_bytes()
            burst = 1 if random.random() < 0.9 else 1000
            rig.robot.bus.faults.injected += [_mutated(random, random.choice(genuine)) for _ in range(burst)]
            sent += burst
            session.step()
            assert _limits_hold(rig)
        assert session.moving > sent // 1000
        assert session.measured.malformed + session.measured.unknown > sent // 4
        # docs/safety.md P07; a leak of 20 bytes a frame shows in `make prove`
        assert _resident_bytes() - before_bytes <= 5_000_000


def _resident_bytes() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
