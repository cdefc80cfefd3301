"""Checks of a CAN bus: its interface, its nodes, and what makes a drive safe without its master."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.canopen.bus import CanBus
from common.canopen.frames import HEARTBEAT, SYNC, consumer_heartbeat
from common.canopen.node import CanopenNode, find_eds
from common.config import BusConfig, Config
from common.errors import DeviceError
from follower.can_bridge.axes import Axis
from follower.can_bridge.robot_axes import make_axes
from station.doctor.findings import Finding, ProbeResult, failed, ok, skipped, warning

_LISTEN_S = 0.15
_QUICK_STOP_ON_LOSS = 3
_MAX_PROFILE_VELOCITY = 0x607F
_LEAST_QUEUE = 64


@dataclass(frozen=True)
class ExpectedNode:
    """A node of the configuration: its EDS, its serial number (0: any), and objects that a bridge sets in it."""

    node_id: int
    label: str
    eds: Path
    serial: int
    objects: tuple[tuple[int, int, int, str], ...]


@dataclass(frozen=True)
class NodeReport:
    """What a node answered: what is wrong with its identity, and which objects are not as the bridge sets them.

    ``refused`` are objects that it does not have, or does not show.
    """

    label: str
    misfit: str = ""
    unset: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()


def follower_nodes(config: Config, config_path: Path) -> list[ExpectedNode]:
    """The Follower's drives and I/O module."""
    can = config.follower_can
    drive_eds, io_eds = find_eds(can.drive_eds, config_path), find_eds(can.io_eds, config_path)
    guard = (0x1016, 1, consumer_heartbeat(can.master_node_id, can.watchdog_ms), f"watchdog {can.watchdog_ms} ms")
    stop = (0x6007, 0, _QUICK_STOP_ON_LOSS, "quick stop without its master")
    nodes = [
        ExpectedNode(axis.node_id, axis.name, drive_eds, axis.config.serial, (guard, stop, *_speed_limit(axis)))
        for axis in make_axes(can, config.base)
    ]
    return [*nodes, ExpectedNode(can.io_node_id, "follower I/O", io_eds, 0, (guard,))]


def _speed_limit(axis: Axis) -> list[tuple[int, int, int, str]]:
    """The speed limit in the wheel drives, in counts/s by the configured geometry."""
    return [
        (index, subindex, value, f"speed limit {value} counts/s")
        for index, subindex, value in axis.extra
        if index == _MAX_PROFILE_VELOCITY
    ]


def leader_nodes(config: Config, config_path: Path) -> list[ExpectedNode]:
    """The Leader's I/O module."""
    can = config.leader_can
    guard = (0x1016, 1, consumer_heartbeat(can.master_node_id, can.watchdog_ms), f"watchdog {can.watchdog_ms} ms")
    return [ExpectedNode(can.io_node_id, "leader I/O", find_eds(can.io_eds, config_path), 0, (guard,))]


def ask_nodes(bus_config: BusConfig, master_id: int, nodes: Sequence[ExpectedNode]) -> list[NodeReport] | None:
    """Ask nodes by SDO upload for their identity and their settings.

    Args:
        bus_config: the bus.
        master_id: node id of a bridge, whose heartbeat would show that it works there.
        nodes: to ask.

    Returns:
        A report for each node; None, and nothing was asked, if another master works on the bus.

    Raises:
        DeviceError: the bus cannot be opened or goes away.
    """
    bus = CanBus(bus_config)
    try:
        if has_master(bus, master_id):
            return None
        return [_ask(bus, node) for node in nodes]
    finally:
        bus.close()


def is_there(bus_config: BusConfig) -> bool:
    """Whether the bus can be opened.

    Raises:
        DeviceError: it cannot.
    """
    CanBus(bus_config).close()
    return True


def has_master(bus: CanBus, master_id: int) -> bool:
    """Whether a master sends SYNC, or the heartbeat of a bridge: every 10 or 20 ms."""
    return bus.hears(SYNC, _LISTEN_S) or bus.hears(HEARTBEAT + master_id, _LISTEN_S)


def _ask(bus: CanBus, expected: ExpectedNode) -> NodeReport:
    node = CanopenNode(bus, expected.node_id, expected.label, expected.eds)
    try:
        node.check_identity(expected.serial)
    except DeviceError as error:
        return NodeReport(expected.label, misfit=str(error))
    unset, refused = list[str](), list[str]()
    for index, subindex, wanted, what in expected.objects:
        try:
            if (found := node.read(index, subindex)) != wanted:
                unset.append(f"{what} ({index:04X}h is {found:#x})")
        except DeviceError as error:
            refused.append(str(error))
    return NodeReport(expected.label, unset=tuple(unset), refused=tuple(refused))


def check_files(missing: ProbeResult[list[str]]) -> Finding:
    """Whether the EDS of drives and I/O modules have what bring-up needs."""
    if missing.value is None:
        return failed("EDS", missing.why, "drive_eds, io_eds: the files that the makers give for these devices")
    if missing.value:
        more = f" (and {len(missing.value) - 1} more)" if len(missing.value) > 1 else ""
        return failed("EDS", f"{missing.value[0]}{more}", "davpc can check-eds FILE shows all of it")
    return ok("EDS", "describe all that bring-up needs")


def check_nodes(robot: str, probed: ProbeResult[list[NodeReport] | None]) -> Finding:
    """Whether every configured node answers and is what it should be."""
    check = f"CAN nodes {robot}"
    if probed.value is None:
        return _unseen(check, probed)
    wrong = [answer.misfit for answer in probed.value if answer.misfit]
    if wrong:
        more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
        remedy = f"power, termination, bitrate, node id: davpc can scan --bus {robot}"
        return failed(check, f"{wrong[0]}{more}", remedy)
    return ok(check, f"{len(probed.value)} answer, with the identity of their EDS")


def check_watchdogs(robot: str, probed: ProbeResult[list[NodeReport] | None]) -> Finding:
    """Whether every node stops by itself, and the wheel drives limit their speed, as configured.

    A node that was just switched on does not: the bridge sets it, and reads it back, before it enables anything.
    """
    check = f"watchdogs {robot}"
    if probed.value is None:
        return _unseen(check, probed)
    asked = [answer for answer in probed.value if not answer.misfit]
    refused = [text for answer in asked for text in answer.refused]
    if refused:
        return failed(
            check,
            refused[0],
            "a drive without this object must not be used: it would not stop by itself, or not limit its speed",
        )
    if not asked:
        return skipped(check, "no node answers")
    unset = [f"{answer.label}: {', '.join(answer.unset)}" for answer in asked if answer.unset]
    if unset:
        remedy = "as after switching on: the bridge sets them before it enables anything"
        return warning(check, f"{len(unset)} of {len(asked)} not set; {unset[0]}", remedy)
    return ok(check, f"{len(asked)} set as configured, read back")


def _unseen(check: str, probed: ProbeResult[list[NodeReport] | None]) -> Finding:
    if not probed.why:
        return skipped(check, "another master works on the bus")
    return failed(check, probed.why, "power, cable, interface: ip -details link show")


def check_interface(robot: str, bus: BusConfig, link: ProbeResult[Mapping[str, Any]]) -> Finding:
    """A kernel's CAN interface, as ``ip -details -json link show`` gives it."""
    check = f"CAN {robot}"
    if bus.interface != "socketcan":
        return skipped(check, f"its interface is {bus.interface}: simulated")
    if link.value is None:
        return failed(check, link.why, f"is the adapter there? deploy/can brings {bus.channel} up")
    data = link.value.get("linkinfo", {}).get("info_data", {})
    state, bitrate = data.get("state", "unknown"), data.get("bittiming", {}).get("bitrate", 0)
    text = f"{bus.channel} {state}, {bitrate} bit/s"
    if "UP" not in link.value.get("flags", ()):
        return failed(
            check,
            f"{bus.channel} is down",
            f"sudo ip link set {bus.channel} up, or systemctl restart systemd-networkd",
        )
    if bitrate != bus.bitrate:
        return failed(
            check, f"{text}, configured are {bus.bitrate}", "the same bitrate for all: 80-davpc-can.network"
        )
    if state in ("BUS-OFF", "STOPPED"):
        return failed(check, text, "wiring, termination 120 Ω at both ends, bitrate of every node")
    if state != "ERROR-ACTIVE":
        return warning(check, text, "errors on the wire: termination, bitrate, shielding; is any node switched on?")
    if not data.get("restart_ms"):
        return warning(check, f"{text}, stays off after a bus-off", "RestartSec= in 80-davpc-can.network")
    if link.value.get("txqlen", 0) < _LEAST_QUEUE:
        return warning(
            check,
            f"{text}, transmit queue {link.value.get('txqlen')}",
            "TransmitQueueLength=128 in 80-davpc-can.link",
        )
    return ok(check, text)
