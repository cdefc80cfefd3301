"""LED array, guide and lock of the Leader as one pure state machine: inputs of its I/O module in, outputs out."""

from __future__ import annotations

from dataclasses import dataclass, field

from common.config import LeaderConfig, LedsConfig
from common.messages import Answer, FollowerSummary, GuideState, LeaderState, LedRequest, LockRequest
from common.timing import NS_PER_MS
from leader.led_array import LedArray
from leader.lock import Lock, LockInputs


@dataclass(frozen=True)
class IoInputs(LockInputs):
    """What the I/O module reads."""

    led_current_a: tuple[float, ...] = ()


@dataclass(frozen=True)
class IoOutputs:
    """What the I/O module is told; the actuator: 1 extend, −1 retract, 0 stay."""

    led_current_a: tuple[float, ...]
    actuator: int


@dataclass
class Answers:
    """Answers that are due, by who was asked."""

    lock: list[Answer] = field(default_factory=list)
    led: list[Answer] = field(default_factory=list)


class LeaderSequence:
    """Steps at 50 Hz. The LEDs are on whenever the Leader runs; the lock moves on request only.

    Args:
        config: lock and LED limits.
        leds: the array.
        queue: how many trolleys were locked before this start; None: not known.
    """

    def __init__(self, config: LeaderConfig, leds: LedsConfig, queue: int | None) -> None:
        self._lock = Lock(config, queue)
        self._leds = LedArray(config, leds)
        self._due = Answers()
        self._follower: FollowerSummary | None = None

    @property
    def queue(self) -> int | None:
        """How many trolleys are locked; None: not known."""
        return self._lock.queue

    @property
    def outputs(self) -> IoOutputs:
        """What the module is to be told now."""
        return IoOutputs(self._leds.currents_a, self._lock.direction)

    def hear(self, follower: FollowerSummary | None) -> None:
        """The Follower's newest summary, None if it is too old; before :meth:`request` and :meth:`step`."""
        self._follower = follower

    def request(self, request: LockRequest, received_ns: int, now_ns: int, seen: IoInputs) -> None:
        """Take a request; its answer comes out of :meth:`step` once it is settled."""
        if now_ns - received_ns > request.valid_for_ms * NS_PER_MS:
            self._due.lock.append(Answer(request.id, "expired", "waited longer than it was valid"))
            return
        answer = self._lock.ask(request, now_ns, seen, self._follower)
        if answer is not None:
            self._due.lock.append(answer)

    def led_request(self, request: LedRequest, received_ns: int, now_ns: int) -> None:
        """Take a request for the LEDs; its answer comes out of the next :meth:`step`."""
        if now_ns - received_ns > request.valid_for_ms * NS_PER_MS:
            self._due.led.append(Answer(request.id, "expired", "waited longer than it was valid"))
            return
        refusal = self._leds.ask(request)
        told = ", ".join(f"{current:.2f}" for current in self._leds.currents_a)
        self._due.led.append(Answer(request.id, "refused" if refusal else "done", refusal or f"told {told} A"))

    def step(self, now_ns: int, seen: IoInputs) -> tuple[LeaderState, Answers]:
        """One step: the state to publish, and answers that are due."""
        settled = self._lock.step(now_ns, seen, self._follower)
        if settled is not None:
            self._due.lock.append(settled)
        self._leds.step(now_ns, seen.led_current_a)
        due, self._due = self._due, Answers()
        return self._state(seen), due

    def _state(self, seen: IoInputs) -> LeaderState:
        leds, lock = self._leds, self._lock
        guide: GuideState = "seated" if seen.beam_seated else "lifted" if seen.guide_lifted else "down"
        return LeaderState(
            ready=leds.lit and lock.state != "fault",
            cause="; ".join(filter(None, (lock.cause if lock.state == "fault" else "", leds.cause)))[:400],
            led_current_a=seen.led_current_a,
            led_fault=leds.fault,
            guide=guide,
            lock=lock.state,
            actuator_current_a=max(0.0, seen.actuator_current_a),
            queue=lock.queue,
            led_setpoint_a=leds.currents_a,
            led_derated=leds.derated,
        )
