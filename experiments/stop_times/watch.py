"""The stop watch on the simulated bus, and the canary that notices stalls of the host."""

from __future__ import annotations

import contextlib
import os
import threading
import time

from common.canopen.bus import BusLostError, CanBus
from common.canopen.frames import RPDO, CanFrame
from common.config import BusConfig
from common.timing import NS_PER_MS, NS_PER_S
from sim.can.bus import SimulatedBus
from sim.can.nodes import FollowerBus
from sim.can.power_states import PowerState

# the drives' watchdog stops them after it (docs/safety.md P02)
LONGEST_GAP_NS = 120 * NS_PER_MS
_CANARY_PERIOD_S = 0.002
_CANARY_PRIORITY = 70
_TAP_WAIT_S = 0.1
_STOPPED = (PowerState.QUICK_STOP_ACTIVE, PowerState.SWITCH_ON_DISABLED)


class WheelNotes:
    """Notes when the wheels were last commanded to move, and first commanded to stop since :meth:`restart`.

    Times are CLOCK_MONOTONIC [ns], None for what has not happened. ``longest_gap_ns`` is the longest time between
    two frames to the wheels; ``gaps_without_stop`` counts those beyond the limit after which they just moved on.
    """

    def __init__(self, node_ids: tuple[int, int]) -> None:
        self._velocity_counts: dict[int, int] = {RPDO[0] + node_id: 0 for node_id in node_ids}
        self.last_rpdo_ns: int | None = None
        self.moving_ns: int | None = None
        self.commanded_ns: int | None = None
        self.stopped_ns: int | None = None
        self.moved_after_stop = 0
        self.longest_gap_ns = 0
        self.gaps_without_stop = 0
        self.fastest_counts = 0
        self._moves = False

    def restart(self) -> None:
        """Forget what was seen."""
        self.commanded_ns = self.stopped_ns = self.moving_ns = None
        self.moved_after_stop = self.longest_gap_ns = self.gaps_without_stop = self.fastest_counts = 0

    def speed_counts(self) -> int:
        """Smaller of the two wheels' target speeds, in counts per second."""
        return min(map(abs, self._velocity_counts.values()))

    def note(self, frame: CanFrame, now_ns: int) -> None:
        """A frame that passed on the bus."""
        if frame.can_id not in self._velocity_counts or len(frame.data) != 6:
            return
        gap_ns = now_ns - (self.last_rpdo_ns or now_ns)
        self.last_rpdo_ns = now_ns
        self.longest_gap_ns = max(self.longest_gap_ns, gap_ns)
        word, velocity = (
            int.from_bytes(frame.data[:2], "little"),
            int.from_bytes(frame.data[2:], "little", signed=True),
        )
        self._velocity_counts[frame.can_id] = velocity
        self.fastest_counts = max(self.fastest_counts, abs(velocity))
        moved, self._moves = self._moves, velocity != 0 and word & 0x04 != 0
        self.gaps_without_stop += gap_ns > LONGEST_GAP_NS and moved and self._moves
        if not self._moves:
            self.commanded_ns = self.commanded_ns or now_ns
        else:
            self.moving_ns = now_ns
            self.moved_after_stop += self.commanded_ns is not None or self.stopped_ns is not None


class StopWatch(SimulatedBus):
    """A bus that notes each frame to the wheels, and when these first stopped themselves."""

    def __init__(self, robot: FollowerBus) -> None:
        super().__init__(robot.bus.nodes)
        self._wheels = (robot.left_wheel, robot.right_wheel)
        self.notes = WheelNotes((robot.left_wheel.node_id, robot.right_wheel.node_id))

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """Note the frame, then let the nodes have it."""
        answers = super().handle(frame, now_ns)
        self.notes.note(frame, now_ns)
        self._note_states(now_ns)
        return answers

    def tick(self, now_ns: int) -> list[CanFrame]:
        """Note what the drives do by themselves."""
        sent = super().tick(now_ns)
        self._note_states(now_ns)
        return sent

    def _note_states(self, now_ns: int) -> None:
        if self.notes.stopped_ns is None and all(wheel.state in _STOPPED for wheel in self._wheels):
            self.notes.stopped_ns = now_ns


class BusTap:
    """Another client of a simulated bus, in a thread of its own: frames are stamped at receipt, never too early."""

    def __init__(self, bus: BusConfig, node_ids: tuple[int, int], priority: int) -> None:
        self.notes = WheelNotes(node_ids)
        self._bus = CanBus(bus)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, args=(priority,), name="tap", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._thread.join()
        self._bus.close()

    def _listen(self, priority: int) -> None:
        with contextlib.suppress(PermissionError):  # where that is refused the canary shows it
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        with contextlib.suppress(BusLostError):
            while not self._stop.is_set():
                frame = self._bus.wait(_TAP_WAIT_S)
                if frame is not None:
                    self.notes.note(frame, time.monotonic_ns())


class Canary:
    """A thread scheduled every 2 ms; its longest delay measures a stall of the host.

    Args:
        cpu: the core on which it sits, above all processes of a robot where that is allowed; None: as its creator.
    """

    def __init__(self, cpu: int | None = None) -> None:
        self._cpu = cpu
        self._worst_ns = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sing, name="canary", daemon=True)
        self._thread.start()

    def restart(self) -> None:
        """Forget earlier stalls."""
        self._worst_ns = 0

    def worst_ms(self) -> float:
        """Longest pause beyond the period since then."""
        return self._worst_ns / NS_PER_MS

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _sing(self) -> None:
        if self._cpu is not None:
            os.sched_setaffinity(0, {self._cpu})
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_CANARY_PRIORITY))
        before_ns = time.monotonic_ns()
        while not self._stop.wait(_CANARY_PERIOD_S):
            now_ns = time.monotonic_ns()
            self._worst_ns = max(self._worst_ns, now_ns - before_ns - round(_CANARY_PERIOD_S * NS_PER_S))
            before_ns = now_ns
