"""Frames from the Follower's bus: PDOs, emergencies and heartbeats, checked, and the faults that they report."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from common.canopen.cia402 import DriveState
from common.canopen.frames import (
    EMCY,
    HEARTBEAT,
    HEARTBEAT_LOST,
    STATE_BOOT_UP,
    TPDO,
    CanFrame,
    Emergency,
    decode_emergency,
)
from common.config import BATTERY_V_PER_COUNT
from common.timing import NS_PER_MS
from follower.can_bridge.axes import OUTSTANDING, Axis
from follower.can_bridge.measurement import STATUS_MAX_AGE_MS

MALFORMED_LIMIT = 3
MALFORMED_WINDOW_MS = 1000
_EMERGENCIES_KEPT = 8
# beyond them no battery is measured: an open wire reads full scale
LOWEST_BATTERY_V, HIGHEST_BATTERY_V = -1.0, 200.0


class StopModule:
    """The Follower's CiA 401 module: bit 0 e-stop clear, bit 1 protective stop clear, analogue 1 battery voltage.

    ``battery_v`` is None while what the input reads can be no battery's voltage.
    """

    name = "follower I/O"

    def __init__(self, node_id: int) -> None:
        self.node_id = node_id
        self.status_ns = -1
        self.emergency: Emergency | None = None
        self.battery_v: float | None = 0.0
        self.bits = 0
        self.expected = 0

    def restart(self) -> None:
        """Forget what an earlier connection reported."""
        self.status_ns, self.expected, self.bits, self.emergency = -1, 0, 0, None

    def handle_pdo(self, data: bytes, stamp_ns: int) -> bool:
        """Take its TPDO; false when it cannot be genuine."""
        if len(data) != 3 or self.expected <= 0:
            return False
        self.expected -= 1
        self.bits = data[0]
        volts = int.from_bytes(data[1:], "little", signed=True) * BATTERY_V_PER_COUNT
        self.battery_v = max(volts, 0.0) if LOWEST_BATTERY_V <= volts <= HIGHEST_BATTERY_V else None
        self.status_ns = stamp_ns
        return True


class Inbound:
    """Handles frames. A frame that cannot be what its identifier claims is dropped and counted in ``malformed``.

    ``unknown`` counts frames of foreign identifiers. ``restarted`` names a node that booted while it was in use: it
    has lost its configuration.
    """

    def __init__(self, axes: Sequence[Axis], io_node_id: int) -> None:
        self.axes = axes
        self.io = StopModule(io_node_id)
        self.malformed = 0
        self.unknown = 0
        self.restarted = ""
        self._by_id = {axis.node_id: axis for axis in axes}
        self._by_tpdo = {TPDO[n] + axis.node_id: (axis, n) for axis in axes for n in range(len(axis.transmit_pdos()))}
        self._malformed_ns: deque[int] = deque(maxlen=MALFORMED_LIMIT)
        self._started_ns: int | None = None

    def restart(self) -> None:
        """A new connection: nothing has been received yet."""
        self.io.restart()
        self.restarted = ""
        self._malformed_ns.clear()
        self._started_ns = None

    def synchronised(self, now_ns: int) -> None:
        """A SYNC went out: one more answer to each TPDO is due."""
        if self._started_ns is None:
            self._started_ns = now_ns
        for axis in self.axes:
            axis.synchronised()
        self.io.expected = min(self.io.expected + 1, OUTSTANDING)

    def handle_frame(self, frame: CanFrame, stamp_ns: int, now_ns: int) -> None:
        """Take a frame that answers the SYNC of ``stamp_ns``."""
        if not self._genuine(frame, stamp_ns):
            self.malformed += 1
            self._malformed_ns.append(now_ns)

    def clear_faults(self) -> None:
        """Forget emergencies and malformed frames: the operator acknowledged them."""
        for axis in self.axes:
            axis.emergencies.clear()
        self.io.emergency = None
        self._malformed_ns.clear()

    def note_stall(self, now_ns: int) -> None:
        """The bridge itself stalled: restart the silence timers."""
        self._started_ns = now_ns

    def faults(self, now_ns: int, stalled: bool = False) -> list[str]:
        """Faults, one line each, naming axis or node; without the consequences of a stall of the bridge.

        Silence of the stop inputs is a fault, except while drives are silent as well: see :meth:`silent`.
        """
        found = [fault for axis in self.axes for fault in _axis_faults(axis, stalled)]
        emergency = self.io.emergency
        if emergency is not None and not (stalled and emergency.code == HEARTBEAT_LOST):
            found.append(f"{self.io.name}: {emergency.name}")
        if self._silent(self.io.status_ns, now_ns) and not self.silent(now_ns):
            found.append(f"{self.io.name}: node {self.io.node_id} is silent")
        return found

    def bad_frames(self, now_ns: int) -> str:
        """Reason while too many recent frames cannot be genuine (corrupt, replayed, a burst of late ones), or ""."""
        if self._many_malformed(now_ns):
            return f"CAN bus: {MALFORMED_LIMIT} frames within a second that cannot be genuine"
        return ""

    def silent(self, now_ns: int) -> list[str]:
        """Drives that do not answer, one line each: that may end by itself, as a fault does not."""
        return [
            f"{axis.name}: node {axis.node_id} is silent"
            for axis in self.axes
            if self._silent(axis.status_ns, now_ns)
        ]

    def inputs_fresh(self, now_ns: int) -> bool:
        """Whether the stop inputs were reported recently enough."""
        return self.io.status_ns >= 0 and not self._silent(self.io.status_ns, now_ns)

    def _many_malformed(self, now_ns: int) -> bool:
        oldest = self._malformed_ns[0] if len(self._malformed_ns) == MALFORMED_LIMIT else None
        return oldest is not None and now_ns - oldest <= MALFORMED_WINDOW_MS * NS_PER_MS

    def _silent(self, status_ns: int, now_ns: int) -> bool:
        """No status for 50 ms; before the first one the time counts from the first SYNC."""
        if self._started_ns is None:
            return False
        return now_ns - max(status_ns, self._started_ns) > STATUS_MAX_AGE_MS * NS_PER_MS

    def _genuine(self, frame: CanFrame, stamp_ns: int) -> bool:
        found = self._by_tpdo.get(frame.can_id)
        if found is not None:
            if self._started_ns is None:
                return True  # a listener that joins between two SYNCs receives answers to one that it missed
            return found[0].handle_pdo(found[1], frame.data, stamp_ns)
        node_id, service = frame.can_id & 0x7F, frame.can_id & 0x780
        if node_id not in self._by_id and node_id != self.io.node_id:
            self.unknown += 1
            return True
        if service == TPDO[0]:
            return self._started_ns is None or self.io.handle_pdo(frame.data, stamp_ns)
        if service == EMCY:
            return self._emergency(node_id, frame.data)
        if service == HEARTBEAT:
            return self._heartbeat(node_id, frame.data)
        self.unknown += 1
        return True

    def _emergency(self, node_id: int, data: bytes) -> bool:
        emergency = decode_emergency(data)
        if emergency is None:
            return False
        axis = self._by_id.get(node_id)
        if axis is None:
            self.io.emergency = emergency if emergency.code else None
        elif emergency.code == 0:
            axis.emergencies.clear()
        elif len(axis.emergencies) < _EMERGENCIES_KEPT:
            axis.emergencies[emergency.code] = emergency
        return True

    def _heartbeat(self, node_id: int, data: bytes) -> bool:
        if len(data) != 1:
            return False
        if data[0] == STATE_BOOT_UP and self._started_ns is not None:
            axis = self._by_id.get(node_id)
            name = axis.name if axis is not None else self.io.name
            self.restarted = f"{name}: node {node_id} restarted and has lost its configuration"
        return True


def _axis_faults(axis: Axis, stalled: bool) -> list[str]:
    """Faults of one axis; a watchdog stop caused by a stall of the bridge is expected and not a fault."""
    expected = {HEARTBEAT_LOST} if stalled else set()
    found = [f"{axis.name}: {each.name}" for code, each in axis.emergencies.items() if code not in expected]
    if axis.state in (DriveState.FAULT, DriveState.FAULT_REACTION) and not axis.emergencies:
        found.append(f"{axis.name}: {axis.state.value}")
    elif axis.was_enabled and axis.state is not DriveState.ENABLED and not (axis.emergencies or stalled):
        found.append(f"{axis.name}: left operation by itself: {axis.state.value}")
    return found
