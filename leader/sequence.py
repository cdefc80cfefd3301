"""LED array, guide and lock of the Leader as a pure state machine: inputs of its I/O module in, outputs out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from common.config import LeaderConfig, LedsConfig
from common.messages import Answer, GuideState, LeaderState, LockRequest, LockState
from common.timing import NS_PER_MS, NS_PER_S

_LED_SETTLE_NS = NS_PER_S // 2


@dataclass(frozen=True)
class IoInputs:
    """What the I/O module reads."""

    led_current_a: tuple[float, ...]
    actuator_current_a: float
    guide_lifted: bool
    beam_seated: bool
    lock_extended: bool
    lock_retracted: bool


@dataclass(frozen=True)
class IoOutputs:
    """What the I/O module is told."""

    led_current_a: tuple[float, ...]
    actuator_extend: bool
    actuator_retract: bool


class LeaderSequence:
    """Steps at 50 Hz. The LEDs are on whenever the Leader runs; the lock moves on request only."""

    def __init__(self, config: LeaderConfig, leds: LedsConfig) -> None:
        self._config = config
        self._leds = leds
        self._lock: LockState | None = None
        self._since_ns = 0
        self._cause = ""
        self._pending: tuple[str, str] | None = None
        self._queue = 0
        self._led_bad_since_ns: int | None = None
        self._answers: deque[Answer] = deque()

    def request(self, request: LockRequest, received_ns: int, now_ns: int, seen: IoInputs) -> None:
        """Take a request; its answer comes out of :meth:`step` once it is settled."""
        self._find_lock(now_ns, seen)
        if now_ns - received_ns > request.valid_for_ms * NS_PER_MS:
            self._answers.append(Answer(request.id, "expired", "waited longer than it was valid"))
            return
        refusal = self._refusal(request, seen)
        if request.action == "confirm" and not refusal:
            self._queue = request.trolley
            self._answers.append(Answer(request.id, "done", f"still locked, {self._queue} trolleys"))
        elif refusal:
            self._answers.append(Answer(request.id, "refused", refusal))
        elif (request.action == "lock") == (self._lock == "locked") and self._lock in ("locked", "open"):
            self._answers.append(Answer(request.id, "done", f"already {self._lock}"))
        else:
            self._pending = (request.id, request.action)
            self._enter("closing" if request.action == "lock" else "opening", now_ns)

    @property
    def outputs(self) -> IoOutputs:
        """What the module is to be told now."""
        currents = tuple(self._leds.current_a for _ in self._leds.positions_m)
        return IoOutputs(currents, self._lock == "closing", self._lock == "opening")

    def step(self, now_ns: int, seen: IoInputs) -> tuple[LeaderState, list[Answer]]:
        """One step: the state to publish, and answers that are due."""
        self._find_lock(now_ns, seen)
        if self._lock == "closing":
            if seen.lock_extended:
                self._queue += 1
                self._settle("locked", "done", "locked", now_ns)
            elif seen.actuator_current_a > self._config.actuator_current_limit_a:
                self._settle("fault", "refused", "actuator jammed: current limit", now_ns)
            elif now_ns - self._since_ns > self._config.lock_travel_timeout_s * NS_PER_S:
                self._settle("fault", "refused", "lock switch not reached in time", now_ns)
        elif self._lock == "opening":
            if seen.lock_retracted:
                self._settle("open", "done", "open", now_ns)
            elif now_ns - self._since_ns > self._config.lock_travel_timeout_s * NS_PER_S:
                self._settle("fault", "refused", "retracted switch not reached in time", now_ns)
        answers = list(self._answers)
        self._answers.clear()
        return self._state(now_ns, seen), answers

    def _find_lock(self, now_ns: int, seen: IoInputs) -> None:
        """After a start the lock is where its switches say it is, wherever this process believed it to be."""
        if self._lock is not None:
            return
        if seen.lock_extended == seen.lock_retracted:
            self._cause = "after the start both lock switches are closed, or neither"
            self._enter("fault", now_ns)
        else:
            self._enter("locked" if seen.lock_extended else "open", now_ns)

    def _refusal(self, request: LockRequest, seen: IoInputs) -> str:
        if self._pending is not None:
            return f"busy with request {self._pending[0]}"
        if self._lock == "fault":
            return f"lock fault: {self._cause}"
        if request.action == "lock" and self._lock == "open" and not seen.beam_seated:
            return "no beam in the guide"
        if request.action == "confirm" and self._lock != "locked":
            return f"the lock is {self._lock}"
        if request.action == "confirm" and self._queue not in (request.trolley - 1, request.trolley):
            return f"{self._queue} trolleys are counted, not {request.trolley - 1}"
        return ""

    def _settle(self, lock: LockState, outcome: str, reason: str, now_ns: int) -> None:
        if self._pending is not None:
            self._answers.append(Answer(self._pending[0], "done" if outcome == "done" else "refused", reason))
            self._pending = None
        if lock == "fault":
            self._cause = reason
        self._enter(lock, now_ns)

    def _enter(self, lock: LockState, now_ns: int) -> None:
        self._lock = lock
        self._since_ns = now_ns

    def _state(self, now_ns: int, seen: IoInputs) -> LeaderState:
        nominal, tolerance = self._leds.current_a, self._config.led_current_tolerance_a
        off = [n for n, current in enumerate(seen.led_current_a) if abs(current - nominal) > tolerance]
        if not off:
            self._led_bad_since_ns = None
        elif self._led_bad_since_ns is None:
            self._led_bad_since_ns = now_ns
        led_fault = self._led_bad_since_ns is not None and now_ns - self._led_bad_since_ns > _LED_SETTLE_NS
        guide: GuideState = "seated" if seen.beam_seated else "lifted" if seen.guide_lifted else "down"
        cause = f"LED {off[0]} draws {seen.led_current_a[off[0]]:.2f} A" if led_fault else self._cause
        return LeaderState(
            ready=not off and self._lock != "fault",
            cause=cause,
            led_current_a=seen.led_current_a,
            led_fault=led_fault,
            guide=guide,
            lock=self._lock or "fault",
            actuator_current_a=max(0.0, seen.actuator_current_a),
            queue=self._queue,
        )
