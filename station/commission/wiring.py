"""What has to be wired and set in the devices, from the configuration: node ids, terminals, units."""

from __future__ import annotations

from collections.abc import Sequence

from common.config import BATTERY_V_PER_COUNT, Config, DriveConfig
from follower.can_bridge.robot_axes import make_axes

_HEAD = {
    "drives": (
        "node",
        "drive (CiA 402)",
        "gear",
        "rated torque, N·m",
        "counts per turn",
        "sign",
        "finds its place by",
    ),
    "terminals": ("node", "terminal", "what"),
}


def wiring(config: Config) -> str:
    """Markdown: both buses, with one table of the Follower's drives and one of each I/O module's terminals."""
    follower, leader = config.follower_can, config.leader_can
    drives = [_drive(axis.name, axis.config, axis.group == "wheels") for axis in make_axes(follower, config.base)]
    return "\n\n".join(
        (
            f"**Follower**, {_bus(follower.bus.bitrate, follower.master_node_id)}",
            _table(_HEAD["drives"], drives),
            _table(_HEAD["terminals"], [(str(follower.io_node_id), *row) for row in _follower_terminals()]),
            f"**Leader**, {_bus(leader.bus.bitrate, leader.master_node_id)}",
            _table(
                _HEAD["terminals"],
                [(str(leader.io_node_id), *row) for row in _leader_terminals(len(config.leds.positions_m))],
            ),
        )
    )


def _bus(bitrate: int, master_id: int) -> str:
    return f"{bitrate // 1000} kbit/s, 120 Ω at both ends; the computer is node {master_id}:"


def _drive(name: str, drive: DriveConfig, is_wheel: bool) -> tuple[str, ...]:
    if drive.homing is not None:
        place = f"homing, method {drive.homing.method}"
    else:
        place = "–" if is_wheel else "absolute encoder"
    turning = (f"{drive.gear_ratio:g}", f"{drive.rated_torque_n_m:g}", f"{drive.counts_per_turn}", f"{drive.sign:+d}")
    return (str(drive.node_id), name, *turning, place)


def _follower_terminals() -> list[tuple[str, str]]:
    return [
        (
            "digital input 1",
            "emergency stop: high while it is not pressed; it cuts the drives' power by itself (STO)",
        ),
        ("digital input 2", "protective stop: high while it is clear"),
        ("analogue input 1", f"battery voltage, {BATTERY_V_PER_COUNT:g} V per count"),
    ]


def _leader_terminals(leds: int) -> list[tuple[str, str]]:
    return [
        ("digital output 1", "lock: extend"),
        ("digital output 2", "lock: retract"),
        ("digital input 1", "guide is lifted"),
        ("digital input 2", "beam is in its seat"),
        ("digital input 3", "lock is extended"),
        ("digital input 4", "lock is retracted"),
        (f"analogue outputs 1 to {leds}", "current of the LEDs in the order of `leds.positions_m`, mA"),
        (f"analogue inputs 1 to {leds}", "current that they draw, mA"),
        ("analogue input 5", "current of the lock's actuator, mA"),
    ]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
