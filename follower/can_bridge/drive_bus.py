"""The Follower's bus as the bridge uses it: bring-up, then one non-blocking exchange a cycle.

Each exchange takes what has arrived, sends heartbeat, every drive's controlword and set-point and SYNC, and moves
every drive one CiA 402 transition towards the requested state. Whatever is wrong turns the request into quick stop:
wheels ramp down and go free, arms hold their position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from common.canopen_bus import BusLostError, CanBus
from common.canopen_frames import (
    EMCY,
    HEARTBEAT,
    NMT_PRE_OPERATIONAL,
    NMT_START,
    STATE_BOOT_UP,
    STATE_OPERATIONAL,
    SYNC,
    TPDO,
    CanFrame,
    decode_emergency,
    heartbeat_frame,
    nmt_frame,
)
from common.canopen_node import CanopenNode, find_eds
from common.cia402 import DriveState, Target
from common.config import BaseConfig, FollowerCanConfig
from common.timing import NS_PER_MS
from follower.can_bridge.axes import Axis, Group
from follower.can_bridge.measurement import DriveSetpoint, Measurement
from follower.can_bridge.robot_axes import make_axes

STATUS_MAX_AGE_MS = 50.0
BATTERY_V_PER_COUNT = 0.01
MALFORMED_LIMIT = 3
MALFORMED_WINDOW_MS = 1000.0
_HEARTBEAT_MS = 100
_ANSWER_NS = NS_PER_MS // 2


@dataclass
class _Requests:
    wheels: Target = Target.DISABLED
    arms: Target = Target.QUICK_STOP
    reset: bool = False
    stalled: str = ""
    lost: str = ""
    malformed_ns: list[int] = field(default_factory=list)


class DriveBus:
    """Eleven drives and one I/O module on one bus."""

    def __init__(self, config: FollowerCanConfig, base: BaseConfig, config_path: Path) -> None:
        self._config = config
        self.axes = make_axes(config, base)
        self._eds = find_eds(config.drive_eds, config_path)
        self._io_eds = find_eds(config.io_eds, config_path)
        self._by_tpdo = {TPDO[n] + axis.node_id: (axis, n) for axis in self.axes for n in (0, 1)}
        self._by_id = {axis.node_id: axis for axis in self.axes}
        self._bus: CanBus | None = None
        self._requests = _Requests()
        self._started_ns: int | None = None
        self._exchanged_ns: int | None = None
        self._syncs = [-1, -1]
        self._inputs = 0
        self._inputs_ns = -1
        self._inputs_expected = 0
        self._io_emergency = ""
        self._battery_v = 0.0
        self.malformed = 0
        self.unknown = 0

    # -- life

    def open(self) -> None:
        """Open the bus and bring every node up, disabled. Also the way back after a lost bus.

        Raises:
            DeviceError: no bus, a silent node, another device, a refused or lost write: named, nothing enabled.
            ConfigError: an EDS is missing or not one.
        """
        self.close()
        bus = CanBus(self._config.bus)
        try:
            self._bring_up(bus)
        except BaseException:
            bus.close()
            raise
        self._bus = bus
        self._requests = _Requests()
        self._started_ns = self._exchanged_ns = None
        self._syncs = [-1, -1]
        self._inputs_ns, self._inputs_expected = -1, 0

    def close(self) -> None:
        """Quick-stop every drive and close the bus: wheels then disable themselves, arms hold."""
        bus, self._bus = self._bus, None
        if bus is None:
            return
        try:
            for axis in self.axes:
                bus.send(axis.command(Target.QUICK_STOP, 0.0, reset=False))
            bus.send(CanFrame(SYNC, b""))
        except BusLostError:
            pass  # the drives' watchdogs do the same by themselves
        finally:
            bus.close()

    def enable(self, groups: Sequence[Group] = ("wheels", "arms")) -> None:
        """Request operation; refused for as long as there are faults."""
        self._requests.stalled = ""
        self._request(Target.ENABLED, groups)

    def disable(self, groups: Sequence[Group] = ("wheels",)) -> None:
        """Request power off. The arms keep holding unless they are named."""
        self._request(Target.DISABLED, groups)

    def quick_stop(self, groups: Sequence[Group] = ("wheels", "arms")) -> None:
        """Request quick stop."""
        self._request(Target.QUICK_STOP, groups)

    def reset_faults(self) -> None:
        """Acknowledge every fault, on a person's request only; the drives stay disabled."""
        self.quick_stop()
        self._requests.reset = True
        self._requests.stalled = ""
        self._requests.malformed_ns.clear()
        self._io_emergency = ""

    # -- cycle

    def exchange(self, now_ns: int, setpoint: DriveSetpoint) -> Measurement:
        """One cycle; never blocks and never raises for what happens on the bus: see ``faults`` and ``bus_ok``."""
        try:
            self._receive(now_ns)
            faults = self._faults(now_ns)
            if faults:
                self.quick_stop()
            self._send(now_ns, setpoint)
        except BusLostError as error:
            self._lose(str(error))
        return self._measurement(now_ns, self._faults(now_ns))

    def _bring_up(self, bus: CanBus) -> None:
        config = self._config
        bus.send(nmt_frame(NMT_PRE_OPERATIONAL))
        io = CanopenNode(bus, config.io_node_id, "follower I/O", self._io_eds)
        io.check_identity()
        io.supervise(_HEARTBEAT_MS, config.master_node_id, config.watchdog_ms)
        io.map_transmit_pdo(1, [(0x6000, 1, 8), (0x6401, 1, 16)])
        for axis in self.axes:
            node = CanopenNode(bus, axis.node_id, axis.name, self._eds)
            node.check_identity(axis.config.serial)
            node.supervise(_HEARTBEAT_MS, config.master_node_id, config.watchdog_ms)
            axis.restart()
            axis.configure(node)
        bus.receive()
        bus.send(nmt_frame(NMT_START))

    def _receive(self, now_ns: int) -> None:
        if self._bus is None:
            raise BusLostError(self._requests.lost or f"CAN bus {self._config.bus.channel}: not open")
        newest, older = self._syncs
        stamp_ns = newest if now_ns - newest >= _ANSWER_NS else older
        for frame in self._bus.receive():
            if not self._take(frame, stamp_ns):
                self.malformed += 1
                self._requests.malformed_ns.append(now_ns)
                del self._requests.malformed_ns[:-MALFORMED_LIMIT]

    def _take(self, frame: CanFrame, stamp_ns: int) -> bool:
        """Digest a frame; false when it cannot be what it says it is."""
        found = self._by_tpdo.get(frame.can_id)
        if found is not None:
            return found[0].take(found[1], frame.data, stamp_ns)
        node_id, service = frame.can_id & 0x7F, frame.can_id & 0x780
        if frame.can_id == TPDO[0] + self._config.io_node_id:
            return self._take_inputs(frame.data, stamp_ns)
        if service == EMCY and node_id:
            return self._take_emergency(node_id, frame.data)
        if service == HEARTBEAT and (node_id in self._by_id or node_id == self._config.io_node_id):
            return self._take_heartbeat(node_id, frame.data)
        self.unknown += 1
        return True

    def _take_inputs(self, data: bytes, stamp_ns: int) -> bool:
        if len(data) != 3 or self._inputs_expected <= 0:
            return False
        self._inputs_expected -= 1
        self._inputs = data[0]
        self._battery_v = max(int.from_bytes(data[1:], "little", signed=True), 0) * BATTERY_V_PER_COUNT
        self._inputs_ns = stamp_ns
        return True

    def _take_emergency(self, node_id: int, data: bytes) -> bool:
        emergency = decode_emergency(data)
        if emergency is None:
            return False
        axis = self._by_id.get(node_id)
        if axis is None:
            if node_id == self._config.io_node_id:
                self._io_emergency = emergency.name if emergency.code else ""
            else:
                self.unknown += 1
        elif emergency.code == 0:
            axis.emergencies.clear()
        else:
            axis.emergencies[emergency.code] = emergency
        return True

    def _take_heartbeat(self, node_id: int, data: bytes) -> bool:
        if len(data) != 1:
            return False
        if data[0] == STATE_BOOT_UP and self._exchanged_ns is not None:
            name = self._by_id[node_id].name if node_id in self._by_id else "follower I/O"
            self._requests.stalled = f"{name}: node {node_id} restarted and has lost its configuration"
        return True

    def _send(self, now_ns: int, setpoint: DriveSetpoint) -> None:
        bus, requests = self._bus, self._requests
        if bus is None:
            return
        bus.send(heartbeat_frame(self._config.master_node_id, STATE_OPERATIONAL))
        for axis, value in zip(self.axes, setpoint.per_axis(), strict=True):
            target = requests.wheels if axis.group == "wheels" else requests.arms
            reset = requests.reset and axis.state is DriveState.FAULT
            bus.send(axis.command(target, value, reset))
            axis.was_enabled = target is Target.ENABLED and (axis.was_enabled or axis.state is DriveState.ENABLED)
            axis.synchronised()
        bus.send(CanFrame(SYNC, b""))
        if requests.reset:
            requests.reset = False
            for axis in self.axes:
                axis.emergencies.clear()
        self._inputs_expected = min(self._inputs_expected + 1, 2)
        self._syncs = [now_ns, self._syncs[0]]
        self._exchanged_ns = now_ns
        if self._started_ns is None:
            self._started_ns = now_ns

    # -- judging

    def _request(self, target: Target, groups: Sequence[Group]) -> None:
        if "wheels" in groups:
            self._requests.wheels = target
        if "arms" in groups:
            self._requests.arms = target

    def _lose(self, reason: str) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None
        self._requests = _Requests(lost=reason)

    def _faults(self, now_ns: int) -> tuple[str, ...]:
        requests = self._requests
        if self._exchanged_ns is not None and now_ns - self._exchanged_ns > self._config.watchdog_ms * NS_PER_MS:
            requests.stalled = f"bridge: stood still for {(now_ns - self._exchanged_ns) // NS_PER_MS} ms"
        found = [text for text in (requests.lost, requests.stalled) if text]
        for axis in self.axes:
            found += _axis_faults(axis, self._silent(axis.status_ns, now_ns))
        if self._io_emergency:
            found.append(f"follower I/O: {self._io_emergency}")
        if self._silent(self._inputs_ns, now_ns):
            found.append(f"follower I/O: node {self._config.io_node_id} is silent")
        recent = [t for t in requests.malformed_ns if now_ns - t <= MALFORMED_WINDOW_MS * NS_PER_MS]
        if len(recent) >= MALFORMED_LIMIT:
            found.append(f"CAN bus: {len(recent)} frames that cannot be genuine within a second")
        return tuple(found)

    def _silent(self, status_ns: int, now_ns: int) -> bool:
        """No status for 50 ms; before the first one the time counts from the first SYNC."""
        if self._started_ns is None:
            return False
        return now_ns - max(status_ns, self._started_ns) > STATUS_MAX_AGE_MS * NS_PER_MS

    def _measurement(self, now_ns: int, faults: tuple[str, ...]) -> Measurement:
        axes = self.axes
        left, right, joints, grippers, lift = axes[0], axes[1], axes[2:8], axes[8:10], axes[10]
        fresh = self._bus is not None and 0 <= now_ns - self._inputs_ns <= STATUS_MAX_AGE_MS * NS_PER_MS
        fresh = fresh and self._inputs_ns >= 0
        return Measurement(
            now_ns=now_ns,
            measured_ns=min(left.status_ns, right.status_ns),
            wheel_speed_rad_s=(left.velocity, right.velocity),
            wheel_angle_rad=(left.position, right.position),
            joint_torque_n_m=tuple(axis.torque_n_m for axis in joints),
            joint_angle_rad=tuple(axis.position for axis in joints),
            grip_torque_n_m=(grippers[0].torque_n_m, grippers[1].torque_n_m),
            grip_angle_rad=(grippers[0].position, grippers[1].position),
            lift_m=lift.position,
            inputs_fresh=fresh,
            estop_clear=fresh and bool(self._inputs & 1),
            protective_clear=fresh and bool(self._inputs & 2),
            battery_v=self._battery_v,
            states=tuple(axis.state for axis in axes),
            wheels_enabled=all(axis.state is DriveState.ENABLED for axis in axes[:2]),
            arms_enabled=all(axis.state is DriveState.ENABLED for axis in axes[2:]),
            bus_ok=self._bus is not None,
            faults=faults,
            malformed=self.malformed,
            unknown=self.unknown,
        )


def _axis_faults(axis: Axis, silent: bool) -> list[str]:
    found = [f"{axis.name}: {emergency.name}" for emergency in axis.emergencies.values()]
    if silent:
        found.append(f"{axis.name}: node {axis.node_id} is silent")
    if axis.state in (DriveState.FAULT, DriveState.FAULT_REACTION) and not axis.emergencies:
        found.append(f"{axis.name}: {axis.state.value}")
    elif axis.was_enabled and axis.state is not DriveState.ENABLED:
        found.append(f"{axis.name}: left operation by itself: {axis.state.value}")
    return found
