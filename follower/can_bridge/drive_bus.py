"""The Follower's bus as the bridge uses it: bring-up, then one non-blocking exchange a cycle.

Each exchange handles what has arrived, sends heartbeat, every drive's controlword and set-point and SYNC, and moves
every drive one CiA 402 transition towards the requested state. Anything wrong turns the request into quick stop:
wheels ramp down and go free, arms hold their position.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from common.canopen.bus import BusLostError, CanBus
from common.canopen.cia402 import DriveState, Target
from common.canopen.frames import (
    HEARTBEAT,
    NMT_PRE_OPERATIONAL,
    NMT_START,
    STATE_OPERATIONAL,
    SYNC,
    CanFrame,
    heartbeat_frame,
    nmt_frame,
)
from common.canopen.node import CanopenNode, find_eds
from common.config import BaseConfig, FollowerCanConfig
from common.errors import DeviceError
from common.timing import NS_PER_MS
from follower.can_bridge.axes import Axis, Group
from follower.can_bridge.inbound import Inbound
from follower.can_bridge.measurement import BusMeasurement, DriveSetpoint
from follower.can_bridge.robot_axes import make_axes, make_homing_axes

_ANSWER_NS = NS_PER_MS // 2
# a master sends its heartbeat every 10 ms; a simulated bus passes nothing to a new client for 50 ms
_ALONE_S = 0.1


class DriveBus:
    """Eleven drives and one I/O module on one bus.

    ``heartbeat`` is withheld by the enable test only, to see the drives' watchdogs fire while they still answer SYNC.

    Args:
        config: nodes, identifiers and limits.
        base: wheel radius and track.
        config_path: the EDS files are beside it.
        listen_only: never send; follow what another bridge does on a live bus.
        homing: axes that have to find their home are in that mode, and at most the one given to :meth:`home` gets
            power.
        clock_ns: the time between two frames: a process that is stopped within an exchange must not send the rest of
            it once it continues.
    """

    def __init__(
        self,
        config: FollowerCanConfig,
        base: BaseConfig,
        config_path: Path,
        listen_only: bool = False,
        homing: bool = False,
        clock_ns: Callable[[], int] | None = None,
    ) -> None:
        self._config = config
        self._listen_only = listen_only
        self._homing = homing
        self._clock_ns = clock_ns
        self._home: Axis | None = None
        self.heartbeat = True
        self.axes = make_homing_axes(config, base) if homing else make_axes(config, base)
        self._eds = find_eds(config.drive_eds, config_path)
        self._io_eds = find_eds(config.io_eds, config_path)
        self._inbound = Inbound(self.axes, config.io_node_id)
        self._bus: CanBus | None = None
        self._wheels = Target.DISABLED
        self._arms = Target.QUICK_STOP
        self._reset = False
        self._lost = ""
        self._stalled = ""
        self._exchanged_ns: int | None = None
        self._syncs = (-1, -1)

    # -- life

    def open(self) -> None:
        """Open the bus and bring every node up, disabled; also after a lost bus.

        Raises:
            DeviceError: no bus, another master active on it, a silent node, another device, a refused or lost write:
                named, nothing enabled.
            ConfigError: an EDS is missing or not one.
        """
        self.close()
        bus = CanBus(self._config.bus)
        for axis in self.axes:
            axis.restart()
        try:
            if not self._listen_only:
                self._bring_up(bus)
        except BaseException:
            bus.close()
            raise
        self._bus = bus
        self._wheels, self._arms, self._reset = Target.DISABLED, Target.QUICK_STOP, False
        self._lost = self._stalled = ""
        self._exchanged_ns = None
        self._syncs = (-1, -1)
        self._home = None
        self._inbound.restart()

    def close(self) -> None:
        """Quick-stop every drive and close the bus: wheels then disable themselves, arms hold."""
        bus, self._bus = self._bus, None
        if bus is None:
            return
        try:
            if not self._listen_only:
                self._send_quick_stop(bus)
        except BusLostError:
            pass  # the drives' watchdogs do the same by themselves
        finally:
            bus.close()

    def enable(self, groups: Sequence[Group] = ("wheels", "arms")) -> None:
        """Request operation; refused while there are faults, and never granted in shadow."""
        if not self._config.shadow:
            self._request(Target.ENABLED, groups)

    def disable(self, groups: Sequence[Group] = ("wheels",)) -> None:
        """Request power off. The arms keep holding unless they are named.

        Acknowledges a stall of the bridge: drives that their watchdogs stopped may be enabled again after that.
        """
        self._stalled = ""
        self._request(Target.DISABLED, groups)

    def quick_stop(self, groups: Sequence[Group] = ("wheels", "arms")) -> None:
        """Request quick stop."""
        self._request(Target.QUICK_STOP, groups)

    def home(self, axis: Axis | None) -> None:
        """On a bus opened for homing: enable this axis alone, to search for its home; None: none."""
        self._home = axis

    def reset_faults(self) -> None:
        """Acknowledge every fault, on the operator's request only; the drives stay disabled."""
        self.quick_stop()
        self._reset = True
        self._stalled = ""
        self._inbound.clear_faults()

    # -- cycle

    def exchange(self, now_ns: int, setpoint: DriveSetpoint) -> BusMeasurement:
        """One cycle. It never blocks, and never raises for what happens on the bus: see ``faults`` and ``bus_ok``.

        Args:
            now_ns: CLOCK_MONOTONIC at the cycle's begin.
            setpoint: for the drives in operation.
        """
        faults: list[str] = []
        silent: list[str] = []
        bad_frames = bus_lost = ""
        try:
            self._receive(now_ns)
            faults = self._faults(now_ns)
            silent, bad_frames = self._inbound.silent(now_ns), self._inbound.bad_frames(now_ns)
            if faults or silent or bad_frames or self._stalled:
                self.quick_stop()
                self._home = None
            self._send(now_ns, setpoint)
            if self._inbound.restarted:
                raise BusLostError(self._inbound.restarted)
        except BusLostError as error:
            self._lose(str(error))
            if self._inbound.restarted:
                faults.insert(0, self._lost)
            else:
                bus_lost = self._lost
        found = {"faults": tuple(faults), "silent": tuple(silent), "bad_frames": bad_frames, "bus_lost": bus_lost}
        return replace(self._measurement(now_ns), **found)  # type: ignore[arg-type] # one type a field

    def _bring_up(self, bus: CanBus) -> None:
        config = self._config
        if bus.hears(HEARTBEAT + config.master_node_id, _ALONE_S):
            raise DeviceError(
                f"CAN bus {bus.name}: another master is active on it (heartbeat of node {config.master_node_id}): "
                "stop its bridge first"
            )
        bus.send(nmt_frame(NMT_PRE_OPERATIONAL))
        io = CanopenNode(bus, config.io_node_id, self._inbound.io.name, self._io_eds)
        io.check_identity()
        io.supervise(config.master_node_id, config.watchdog_ms)
        io.map_transmit_pdo(1, [(0x6000, 1, 8), (0x6401, 1, 16)])
        for axis in self.axes:
            node = CanopenNode(bus, axis.node_id, axis.name, self._eds)
            node.check_identity(axis.config.serial)
            node.supervise(config.master_node_id, config.watchdog_ms)
            axis.configure(node)
        bus.receive()
        bus.send(nmt_frame(NMT_START))

    def _receive(self, now_ns: int) -> None:
        if self._bus is None:
            raise BusLostError(self._lost or f"CAN bus {self._config.bus.channel}: not open")
        newest, older = self._syncs
        stamp_ns = newest if now_ns - newest >= _ANSWER_NS else older
        for frame in self._bus.receive():
            if self._listen_only and frame.can_id == SYNC:
                self._inbound.synchronised(now_ns)
                stamp_ns = now_ns
            else:
                self._inbound.handle_frame(frame, stamp_ns, now_ns)

    def _send(self, now_ns: int, setpoint: DriveSetpoint) -> None:
        bus = self._bus
        self._exchanged_ns = now_ns
        if bus is None or self._listen_only:
            return
        if self.heartbeat:
            bus.send(heartbeat_frame(self._config.master_node_id, STATE_OPERATIONAL))
        for axis, value in zip(self.axes, setpoint.per_axis(), strict=True):
            if self._clock_ns is not None and not self._stalled and self._check_stall(now_ns, self._clock_ns()):
                self.quick_stop()
            target = self._target(axis)
            reset = self._reset and axis.state is DriveState.FAULT
            bus.send(axis.command(target, value, reset))
            axis.was_enabled = target is Target.ENABLED and (axis.was_enabled or axis.state is DriveState.ENABLED)
        bus.send(CanFrame(SYNC, b""))
        self._reset = False
        self._syncs = (now_ns, self._syncs[0])
        self._inbound.synchronised(now_ns)

    def _target(self, axis: Axis) -> Target:
        if self._homing:
            return Target.ENABLED if axis is self._home else Target.DISABLED
        return self._wheels if axis.group == "wheels" else self._arms

    def _send_quick_stop(self, bus: CanBus) -> None:
        for axis in self.axes:
            bus.send(axis.command(Target.QUICK_STOP, None, reset=False))
        bus.send(CanFrame(SYNC, b""))

    # -- judging

    def _request(self, target: Target, groups: Sequence[Group]) -> None:
        if "wheels" in groups:
            self._wheels = target
        if "arms" in groups:
            self._arms = target

    def _lose(self, reason: str) -> None:
        self.close()
        self._lost = reason
        self._wheels, self._arms, self._reset = Target.DISABLED, Target.QUICK_STOP, False

    def _faults(self, now_ns: int) -> list[str]:
        if self._bus is not None and self._exchanged_ns is not None:
            self._check_stall(self._exchanged_ns, now_ns)
        return self._inbound.faults(now_ns, bool(self._stalled))

    def _check_stall(self, since_ns: int, now_ns: int) -> bool:
        """Whether this process stalled for so long that the drives' watchdogs stopped them."""
        stalled_ns = now_ns - since_ns
        if stalled_ns <= self._config.watchdog_ms * NS_PER_MS:
            return False
        self._stalled = f"bridge: stalled for {stalled_ns // NS_PER_MS} ms"
        self._inbound.note_stall(now_ns)
        return True

    def _measurement(self, now_ns: int) -> BusMeasurement:
        axes, io = self.axes, self._inbound.io
        left, right, joints, grippers, lift = axes[0], axes[1], axes[2:8], axes[8:10], axes[10]
        fresh = self._bus is not None and self._inbound.inputs_fresh(now_ns)
        return BusMeasurement(
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
            estop_clear=fresh and bool(io.bits & 1),
            protective_clear=fresh and bool(io.bits & 2),
            battery_v=io.battery_v,
            states=tuple(axis.state for axis in axes),
            wheels_enabled=self._bus is not None and all(axis.state is DriveState.ENABLED for axis in axes[:2]),
            arms_enabled=self._bus is not None and all(axis.state is DriveState.ENABLED for axis in axes[2:]),
            bus_ok=self._bus is not None,
            faults=(),
            malformed=self._inbound.malformed,
            unknown=self._inbound.unknown,
            stalled=self._stalled,
        )
