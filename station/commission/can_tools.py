"""``davpc can``: which nodes are on a bus, and what they do.

Nothing here prints: the command line shows what is returned.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from common.canopen.bus import CanBus
from common.canopen.frames import HEARTBEAT, SDO_REQUEST, SDO_RESPONSE, CanFrame
from common.config import BusConfig, Config
from common.timing import NS_PER_MS
from follower.can_bridge.drive_bus import DriveBus
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint

_ANSWER_S = 0.2
_NMT_STATES = {0x00: "booting", 0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational"}
_PROFILES = {401: "I/O module", 402: "drive", 404: "measuring device", 406: "encoder", 410: "inclinometer"}


@dataclass(frozen=True)
class FoundNode:
    """A node that answered: its identity (1000h, 1018h) and what the configuration calls it, "" if nothing."""

    node_id: int
    profile: str
    vendor: int
    product: int
    revision: int
    serial: int
    state: str
    name: str


def scan(bus_config: BusConfig, names: dict[int, str]) -> list[FoundNode]:
    """Ask every node id for its identity. Reads only: no state changes, nothing is configured.

    Args:
        bus_config: the bus; a bridge may be working on it meanwhile, but its own SDO transfers would be disturbed.
        names: what the configuration calls the nodes: see :func:`follower_names`.

    Raises:
        DeviceError: the bus cannot be opened or goes away.
    """
    bus = CanBus(bus_config)
    try:
        types, states = _ask(bus, range(1, 128), 0x1000, 0)
        vendors, products, revisions, serials = (
            _ask(bus, sorted(types), 0x1018, subindex)[0] for subindex in (1, 2, 3, 4)
        )
    finally:
        bus.close()
    return [
        FoundNode(
            node_id=node_id,
            profile=_PROFILES.get(kind & 0xFFFF, f"profile {kind & 0xFFFF}"),
            vendor=vendors.get(node_id, 0),
            product=products.get(node_id, 0),
            revision=revisions.get(node_id, 0),
            serial=serials.get(node_id, 0),
            state=states.get(node_id, ""),
            name=names.get(node_id, ""),
        )
        for node_id, kind in sorted(types.items())
    ]


def follower_names(config: Config, config_path: Path) -> dict[int, str]:
    """What the configuration calls the nodes of the Follower's bus."""
    names = {axis.node_id: axis.name for axis in _drives(config, config_path, listen_only=True).axes}
    return {**names, config.follower_can.io_node_id: "follower I/O"}


@dataclass(frozen=True)
class NodeRow:
    """A line of the monitor. Values at the output shaft: rad and rad/s, metres for the lift; torque in N·m."""

    node_id: int
    name: str
    state: str
    position: float
    velocity: float
    torque_n_m: float
    age_ms: float
    faults: tuple[str, ...]


class Monitor:
    """Follows a live bus without sending anything: needs a bridge there that sends SYNC."""

    def __init__(self, config: Config, config_path: Path) -> None:
        self._drives = _drives(config, config_path, listen_only=True)

    def open(self) -> None:
        """Open the bus.

        Raises:
            DeviceError: it cannot be opened.
        """
        self._drives.open()

    def close(self) -> None:
        """Close the bus."""
        self._drives.close()

    def poll(self, now_ns: int) -> tuple[list[NodeRow], BusMeasurement]:
        """What came since the last call: one row a drive, and the whole."""
        measured = self._drives.exchange(now_ns, DriveSetpoint())
        rows = [
            NodeRow(
                axis.node_id,
                axis.name,
                axis.state.value,
                axis.position,
                axis.velocity,
                axis.torque_n_m,
                (now_ns - axis.status_ns) / NS_PER_MS if axis.status_ns >= 0 else float("inf"),
                tuple(fault for fault in measured.troubles if fault.startswith(f"{axis.name}:")),
            )
            for axis in self._drives.axes
        ]
        return rows, measured


def _drives(config: Config, config_path: Path, listen_only: bool) -> DriveBus:
    return DriveBus(config.follower_can, config.base, config_path, listen_only)


def _ask(bus: CanBus, node_ids: Iterable[int], index: int, subindex: int) -> tuple[dict[int, int], dict[int, str]]:
    """SDO upload of a number of up to 4 bytes from many nodes at once; heartbeats that passed by."""
    waiting = list(node_ids)
    for node_id in waiting:
        bus.send(CanFrame(SDO_REQUEST + node_id, struct.pack("<BHB4x", 0x40, index, subindex)))
    values: dict[int, int] = {}
    states: dict[int, str] = {}
    while frame := bus.wait(_ANSWER_S):
        node_id, service = frame.can_id & 0x7F, frame.can_id & 0x780
        if service == HEARTBEAT and len(frame.data) == 1:
            states[node_id] = _NMT_STATES.get(frame.data[0], "unknown")
        elif service == SDO_RESPONSE and _answers(frame.data, index, subindex):
            values[node_id] = int.from_bytes(frame.data[4:8], "little")
        if set(waiting) <= set(values):
            break
    return values, states


def _answers(data: bytes, index: int, subindex: int) -> bool:
    """An expedited upload response of this object (CiA 301)."""
    return len(data) == 8 and data[0] & 0xE2 == 0x42 and data[1:4] == struct.pack("<HB", index, subindex)
