"""LED array, guide and lock of the Leader as one pure state machine: inputs of its I/O module in, outputs out."""

from __future__ import annotations

from dataclasses import dataclass, field

from common.config import LeaderConfig, LedsConfig
from common.messages import Answer, FollowerSummary, GuideState, LeaderState, LedRequest, LockRequest
from common.timing import NS_PER_MS
from leader.led_array import LedDriver
from leader.lock import BoltLock, LockInputs


@dataclass(frozen=True, kw_only=True)
class IoInputs(LockInputs):
    """What the I/O module reads."""

    led_current_a: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class IoOutputs:
    """Set-points of the I/O module; the actuator: 1 extend, −1 retract, 0 stay."""

    led_current_a: tuple[float, ...]
    actuator: int


@dataclass
class Answers:
    """Answers that are due, by the request's channel."""

    lock: list[Answer] = field(default_factory=list)
    led: list[Answer] = field(default_factory=list)


class LeaderSequence:
    """Steps at 50 Hz. The LEDs are on whenever the Leader runs; the lock moves on request only.

    Args:
        config: lock and LED limits.
        leds: the array.
        queue: number of trolleys locked before this start; None: unknown.
    """

    def __init__(self, config: LeaderConfig, leds: LedsConfig, queue: int | None) -> None:
        self._lock = BoltLock(config, queue)
        self._leds = LedDriver(config, leds)
        self._due = Answers()
        self._follower: FollowerSummary | None = None

    @property
    def queue(self) -> int | None:
        """Number of locked trolleys; None: unknown."""
        return self._lock.queue

    @property
    def outputs(self) -> IoOutputs:
        """Set-points for the module now."""
        return IoOutputs(led_current_a=self._leds.currents_a, actuator=self._lock.direction)

    def set_follower(self, follower: FollowerSummary | None) -> None:
        """The Follower's newest summary, None if it is too old; before :meth:`request` and :meth:`step`."""
        self._follower = follower

    def request(self, request: LockRequest, received_ns: int, now_ns: int, inputs: IoInputs) -> None:
        """Take a request; its answer comes from :meth:`step` once it is settled.

        Args:
            request: for the lock.
            received_ns: when it arrived on this machine; it is valid for ``valid_for_ms`` from then.
            now_ns: time of this step.
            inputs: newest reading of the I/O module.
        """
        if now_ns - received_ns > request.valid_for_ms * NS_PER_MS:
            self._due.lock.append(Answer(request.id, "expired", "expired before it was handled"))
            return
        answer = self._lock.ask(request, now_ns, inputs, self._follower)
        if answer is not None:
            self._due.lock.append(answer)

    def led_request(self, request: LedRequest, received_ns: int, now_ns: int) -> None:
        """Take a request for the LEDs; its answer comes from the next :meth:`step`."""
        if now_ns - received_ns > request.valid_for_ms * NS_PER_MS:
            self._due.led.append(Answer(request.id, "expired", "expired before it was handled"))
            return
        refusal = self._leds.ask(request)
        currents = ", ".join(f"{current:.2f}" for current in self._leds.currents_a)
        self._due.led.append(Answer(request.id, "refused" if refusal else "done", refusal or f"set to {currents} A"))

    def step(self, now_ns: int, inputs: IoInputs) -> tuple[LeaderState, Answers]:
        """One step: the state to publish, and answers that are due."""
        settled = self._lock.step(now_ns, inputs, self._follower)
        if settled is not None:
            self._due.lock.append(settled)
        self._leds.step(now_ns, inputs.led_current_a)
        due, self._due = self._due, Answers()
        return self._state(inputs), due

    def _state(self, inputs: IoInputs) -> LeaderState:
        leds, lock = self._leds, self._lock
        drawn_a, set_a = leds.measured
        guide: GuideState = "seated" if inputs.beam_seated else "lifted" if inputs.guide_lifted else "down"
        return LeaderState(
            ready=leds.lit and lock.state != "fault",
            cause="; ".join(filter(None, (lock.cause if lock.state == "fault" else "", leds.cause)))[:400],
            led_current_a=drawn_a,
            led_fault=leds.fault,
            guide=guide,
            lock=lock.state,
            actuator_current_a=max(0.0, inputs.actuator_current_a),
            queue=lock.queue,
            led_setpoint_a=set_a,
            led_derated=leds.derated,
        )
