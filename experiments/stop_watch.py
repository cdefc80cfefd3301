"""The stop watch on the simulated bus, and the canary that tells when the host itself stood still."""

from __future__ import annotations

import threading
import time

from common.canopen_frames import RPDO, CanFrame
from common.timing import NS_PER_MS, NS_PER_S
from sim.can_bus import SimulatedBus
from sim.can_nodes import FollowerBus
from sim.drive_402 import PowerState

_CANARY_PERIOD_S = 0.002
_STOPPED = (PowerState.QUICK_STOP_ACTIVE, PowerState.SWITCH_ON_DISABLED)


class StopWatch(SimulatedBus):
    """A bus that remembers when the wheels were last told to move, first told to stop, and first stopped themselves.

    Times are CLOCK_MONOTONIC [ns], None for what has not happened since :meth:`restart`.
    """

    def __init__(self, robot: FollowerBus) -> None:
        super().__init__(robot.bus.nodes)
        self._wheels = (robot.left_wheel, robot.right_wheel)
        self._ids = {RPDO[0] + wheel.node_id for wheel in self._wheels}
        self.last_rpdo_ns: int | None = None
        self.moving_ns: int | None = None
        self.told_ns: int | None = None
        self.stopped_ns: int | None = None
        self.moved_after_stop = 0

    def restart(self) -> None:
        """Forget what was seen."""
        self.told_ns = self.stopped_ns = self.moving_ns = None
        self.moved_after_stop = 0

    def speed_counts(self) -> int:
        """Smaller of the two wheels' target speeds, in counts per second."""
        return min(abs(wheel.values[0x60FF, 0]) for wheel in self._wheels)

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """Note the frame, then let the nodes have it."""
        answers = super().handle(frame, now_ns)
        if frame.can_id in self._ids and len(frame.data) == 6:
            self._note(frame.data, now_ns)
        self._note_states(now_ns)
        return answers

    def tick(self, now_ns: int) -> list[CanFrame]:
        """Note what the drives do by themselves."""
        sent = super().tick(now_ns)
        self._note_states(now_ns)
        return sent

    def _note(self, data: bytes, now_ns: int) -> None:
        self.last_rpdo_ns = now_ns
        word, velocity = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:], "little")
        if velocity == 0 or word & 0x04 == 0:
            self.told_ns = self.told_ns or now_ns
        else:
            self.moving_ns = now_ns
            self.moved_after_stop += self.told_ns is not None or self.stopped_ns is not None

    def _note_states(self, now_ns: int) -> None:
        if self.stopped_ns is None and all(wheel.state in _STOPPED for wheel in self._wheels):
            self.stopped_ns = now_ns


class Canary:
    """A thread that wants to run every 2 ms: the longest time that it could not is the host's fault."""

    def __init__(self) -> None:
        self._worst_ns = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sing, name="canary", daemon=True)
        self._thread.start()

    def restart(self) -> None:
        """Begin to look anew."""
        self._worst_ns = 0

    def worst_ms(self) -> float:
        """Longest pause beyond the period since then."""
        return self._worst_ns / NS_PER_MS

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _sing(self) -> None:
        before_ns = time.monotonic_ns()
        while not self._stop.wait(_CANARY_PERIOD_S):
            now_ns = time.monotonic_ns()
            self._worst_ns = max(self._worst_ns, now_ns - before_ns - round(_CANARY_PERIOD_S * NS_PER_S))
            before_ns = now_ns
