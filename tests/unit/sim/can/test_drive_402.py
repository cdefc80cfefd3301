"""The simulated drive against two judges that are not ours: the canopen library's own 402 profile, and the standard.

The frames of the table are written from CiA 301 and CiA 402, not recorded.
"""

from __future__ import annotations

from typing import Any

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from common.canopen.frames import CanFrame
from common.config import DriveConfig
from common.timing import NS_PER_MS
from sim.can.drive_402 import Drive402
from sim.can.drive_profile import approach, ramp
from tests.rigs.canbus_rig import DRIVE_EDS

WHEEL = DriveConfig(node_id=1, gear_ratio=20.0)


class _DirectNetwork(canopen.Network):
    """The library's network with one simulated drive at the other end of the call."""

    def __init__(self, drive: Drive402) -> None:
        super().__init__()
        self.drive = drive
        self.now_ns = NS_PER_MS

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        del remote
        self.now_ns += NS_PER_MS
        answers = self.drive.handle(CanFrame(can_id, bytes(data)), self.now_ns)
        for answer in answers + self.drive.tick(self.now_ns):
            self.notify(answer.can_id, bytearray(answer.data), 0.0)


@pytest.fixture
def master() -> Any:
    """Another maker's CiA 402 master."""
    make_node: Any = BaseNode402
    node = make_node(1, canopen.import_od(str(DRIVE_EDS), 1))
    network = _DirectNetwork(Drive402(WHEEL, DRIVE_EDS))
    network.add_node(node)
    node.drive = network.drive
    return node


def test_the_librarys_master_drives_it_through_all_states(master: Any) -> None:
    master.sdo[0x605A].raw = 6
    assert master.state == "SWITCH ON DISABLED"
    for wanted in (
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "SWITCHED ON",
        "READY TO SWITCH ON",
        "SWITCH ON DISABLED",
        "OPERATION ENABLED",
        "QUICK STOP ACTIVE",
        "OPERATION ENABLED",
        "SWITCH ON DISABLED",
    ):
        master.state = wanted
        assert master.state == wanted


def test_the_librarys_master_sees_and_resets_a_fault(master: Any) -> None:
    master.state = "OPERATION ENABLED"
    master.drive.trip(0x2310)
    assert master.sdo[0x603F].raw == 0x2310
    assert master.is_faulted()
    assert [entry.code for entry in master.emcy.active] == [0x2310]
    master.TIMEOUT_RESET_FAULT = 0.0
    master.reset_from_fault()
    assert master.state == "OPERATION ENABLED"
    assert master.emcy.active == []


def test_the_librarys_master_sets_modes(master: Any) -> None:
    for mode in ("PROFILED VELOCITY", "PROFILED TORQUE", "PROFILED POSITION"):
        master.op_mode = mode
        assert master.op_mode == mode
    with pytest.raises(TypeError):
        master.op_mode = "CYCLIC SYNCHRONOUS TORQUE"


# sent, answers; xx is a byte that the standard leaves to the maker
TABLE: tuple[tuple[str, list[str]], ...] = (
    ("601 40 00 10 00 00 00 00 00", ["581 43 00 10 00 92 01 02 00"]),  # device type: drive with profile 402
    ("601 40 18 10 01 00 00 00 00", ["581 43 18 10 01 00 DA 00 00"]),  # vendor
    ("601 40 08 10 00 00 00 00 00", ["581 41 08 10 00 05 00 00 00"]),  # name: 5 bytes, segmented
    ("601 60 00 00 00 00 00 00 00", ["581 05 64 61 76 70 63 00 00"]),  # the one segment, no more to come
    ("601 40 00 50 00 00 00 00 00", ["581 80 00 50 00 00 00 02 06"]),  # no such object
    ("601 23 18 10 01 01 00 00 00", ["581 80 18 10 01 02 00 01 06"]),  # read-only
    ("601 2B 60 60 00 03 00 00 00", ["581 80 60 60 00 10 00 07 06"]),  # two bytes for an INTEGER8
    ("601 2F 60 60 00 09 00 00 00", ["581 80 60 60 00 31 00 09 06"]),  # above the highest value
    ("601 2F 60 60 00 03 00 00 00", ["581 60 60 60 00 00 00 00 00"]),  # profile velocity
    ("601 40 61 60 00 00 00 00 00", ["581 4F 61 60 00 03 00 00 00"]),  # mode display
    ("601 23 00 14 01 01 02 00 80", ["581 60 00 14 01 00 00 00 00"]),  # RPDO 1 off
    ("601 2F 00 16 00 00 00 00 00", ["581 60 00 16 00 00 00 00 00"]),
    ("601 23 00 16 01 10 00 40 60", ["581 60 00 16 01 00 00 00 00"]),  # controlword, 16 bits
    ("601 23 00 16 02 20 00 FF 60", ["581 60 00 16 02 00 00 00 00"]),  # target velocity, 32 bits
    ("601 2F 00 16 00 02 00 00 00", ["581 60 00 16 00 00 00 00 00"]),
    ("601 2F 00 14 02 01 00 00 00", ["581 60 00 14 02 00 00 00 00"]),  # at SYNC
    ("601 23 00 14 01 01 02 00 00", ["581 60 00 14 01 00 00 00 00"]),  # RPDO 1 on
    ("601 23 00 16 01 10 00 40 60", ["581 80 00 16 01 22 00 00 08"]),  # no mapping while it is on
    ("601 23 00 18 01 81 01 00 80", ["581 60 00 18 01 00 00 00 00"]),  # TPDO 1 off
    ("601 23 00 1A 01 10 00 41 60", ["581 60 00 1A 01 00 00 00 00"]),  # statusword
    ("601 2F 00 1A 00 01 00 00 00", ["581 60 00 1A 00 00 00 00 00"]),
    ("601 2F 00 18 02 01 00 00 00", ["581 60 00 18 02 00 00 00 00"]),
    ("601 23 00 18 01 81 01 00 00", ["581 60 00 18 01 00 00 00 00"]),  # TPDO 1 on
    ("080", []),  # SYNC before NMT start
    ("000 01 01", []),  # NMT start of node 1
    ("000 80 02", []),  # pre-operational, but another node
    ("080", ["181 50 xx"]),  # switch on disabled
    ("201 06 00 00 00 00 00", []),  # shutdown
    ("080", ["181 31 xx"]),  # ready to switch on
    ("201 07 00 00 00 00 00", []),  # switch on
    ("080", ["181 33 xx"]),
    ("201 0F 00 00 00 00 00", []),  # enable operation
    ("080", ["181 37 xx"]),
    ("201 02 00 00 00 00 00", []),  # quick stop
    ("080", ["181 17 xx"]),
    ("080", ["181 50 xx"]),  # 605Ah = 2: it stood, so it is off
    ("201 06 00 00 00", ["081 10 82 10 00 00 00 00 00"]),  # a byte short: EMCY 8210h, not processed
    ("080", ["181 50 xx"]),
    ("000 80 00", []),  # everybody pre-operational
    ("080", []),
)


def _frame(text: str) -> CanFrame:
    identifier, *octets = text.split()
    return CanFrame(int(identifier, 16), bytes(int(octet, 16) for octet in octets))


def _shown(frame: CanFrame, pattern: str) -> str:
    octets = [f"{octet:02X}" for octet in frame.data]
    wanted = pattern.split()[1:]
    shown = ["xx" if n < len(wanted) and wanted[n] == "xx" else octet for n, octet in enumerate(octets)]
    return " ".join([f"{frame.can_id:03X}", *shown])


def test_frames_of_the_standard_byte_by_byte() -> None:
    drive = Drive402(WHEEL, DRIVE_EDS)
    now_ns = NS_PER_MS
    assert drive.tick(now_ns) == [CanFrame(0x701, b"\x00")]
    for sent, expected in TABLE:
        now_ns += NS_PER_MS
        answers = drive.handle(_frame(sent), now_ns)
        shown = [_shown(answer, pattern) for answer, pattern in zip(answers, expected, strict=False)]
        assert (sent, shown, len(answers)) == (sent, expected, len(expected))


def test_a_wheel_follows_its_ramps_and_its_limit() -> None:
    drive = Drive402(WHEEL, DRIVE_EDS)
    counts = 65536 * 20
    values = {0x6060: 3, 0x6083: counts, 0x6084: 2 * counts, 0x6085: 4 * counts, 0x607F: 3 * counts}
    for index, value in values.items():
        drive.set_data(index, 0, value.to_bytes(1 if index == 0x6060 else 4, "little"))
    drive.advance(1)
    for word in (6, 7, 15):
        drive.set_data(0x6040, 0, word.to_bytes(2, "little"))
    drive.set_data(0x60FF, 0, (5 * counts).to_bytes(4, "little"))
    turns = []
    for n in range(1, 5):
        drive.advance(n * 1_000_000_000)
        turns.append(drive.velocity_setpoint_rad_s / 6.283185307)
    assert turns == pytest.approx([1.0, 2.0, 3.0, 3.0], rel=1e-6)
    drive.set_data(0x60FF, 0, bytes(4))
    drive.advance(4_500_000_000)
    assert drive.velocity_setpoint_rad_s / 6.283185307 == pytest.approx(2.0, rel=1e-6)
    drive.set_data(0x6040, 0, b"\x02\x00")
    drive.advance(4_750_000_000)
    assert drive.velocity_setpoint_rad_s / 6.283185307 == pytest.approx(1.0, rel=1e-6)
    assert drive.enabled
    drive.advance(5_001_000_000)
    assert not drive.enabled


@pytest.mark.parametrize(
    ("value", "target", "expected"),
    [(0.0, 5.0, 1.0), (5.0, 0.0, 3.0), (1.0, -5.0, -0.5), (-5.0, 1.0, -3.0), (0.5, 0.6, 0.6)],
)
def test_ramp_goes_through_zero(value: float, target: float, expected: float) -> None:
    assert ramp(value, target, 1.0, 2.0, 1.0) == pytest.approx(expected)


@pytest.mark.parametrize("target", [0.3, -0.2, 0.001])
def test_position_profile_arrives_without_overshoot(target: float) -> None:
    position = speed = 0.0
    for _ in range(4000):
        position, speed = approach(position, speed, target, 0.1, 0.5, 0.002)
        assert abs(speed) <= 0.1 + 1e-9
        assert abs(position) <= abs(target) + 1e-9
    assert (position, speed) == (target, 0.0)
