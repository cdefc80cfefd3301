"""Leader process: LED array, guide and lock over CAN, heartbeat."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.canopen_bus import BusLostError
from common.canopen_io import LeaderInputs, LeaderIo
from common.channels import LEADER_STATE, LOCK_REQUEST
from common.messages import Answer, LeaderState
from common.node import DeviceError, Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from leader.sequence import IoInputs, LeaderSequence

_STEPS_PER_HEARTBEAT = 5
_REOPEN_NS = NS_PER_S
_log = logging.getLogger("leader")


class LeaderNode(Node):
    """Exchanges with the I/O module at 50 Hz; its state at 10 Hz, and at once when it changes, is the heartbeat."""

    name = "leader"
    outputs = (LEADER_STATE,)
    serves = (LOCK_REQUEST,)
    trigger = Trigger(period_ns=NS_PER_S // 50)

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._sequence = LeaderSequence(config.leader, config.leds)
        self._io = LeaderIo(config.leader_can, context.config_path, len(config.leds.positions_m))
        self._seen: IoInputs | None = None
        self._published: LeaderState | None = None
        self._steps = 0
        self._reopen_ns: int | None = None

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Bring the I/O module up."""
        self._io.open()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """One exchange with the module and one step of the sequence."""
        requests = inputs.requests(LOCK_REQUEST)
        seen = self._exchange(now_ns)
        if seen is None:
            refused = [Answer(received.message.id, "refused", "I/O module silent") for received in requests]
            silent = _silent(len(self._sequence.outputs.led_current_a))
            return [*self._heartbeat(silent), *((LOCK_REQUEST, answer) for answer in refused)]
        for received in requests:
            self._sequence.request(received.message, received.receipt_ns, now_ns, seen)
        state, answers = self._sequence.step(now_ns, seen)
        return [*self._heartbeat(state), *((LOCK_REQUEST, answer) for answer in answers)]

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Stop the actuator; the LEDs stay as they are."""
        self._io.close()
        return ()

    def _exchange(self, now_ns: int) -> IoInputs | None:
        """What the module reads; None while it cannot be reached."""
        if self._reopen_ns is not None and not self._reopened(now_ns):
            return None
        told = self._sequence.outputs
        self._io.set_led_currents(told.led_current_a)
        self._io.drive_actuator(int(told.actuator_extend) - int(told.actuator_retract))
        try:
            read = self._io.exchange(now_ns)
        except BusLostError as error:
            _log.error("%s", error)
            self._reopen_ns = now_ns + _REOPEN_NS
            return None
        return _io_inputs(read) if read.fresh else None

    def _reopened(self, now_ns: int) -> bool:
        if self._reopen_ns is None or now_ns < self._reopen_ns:
            return False
        try:
            self._io.open()
        except (DeviceError, BusLostError) as error:
            _log.warning("%s", error)
            self._reopen_ns = now_ns + _REOPEN_NS
            return False
        self._reopen_ns = None
        return True

    def _heartbeat(self, state: LeaderState) -> list[Output]:
        self._steps += 1
        changed = self._published is None or _key(state) != _key(self._published)
        if not changed and self._steps % _STEPS_PER_HEARTBEAT:
            return []
        self._published = state
        return [(LEADER_STATE, state)]


def _key(state: LeaderState) -> tuple[object, ...]:
    """What makes a state worth a message of its own; currents alone do not."""
    return state.ready, state.cause, state.led_fault, state.guide, state.lock, state.queue


def _io_inputs(read: LeaderInputs) -> IoInputs:
    return IoInputs(
        led_current_a=read.led_current_a,
        actuator_current_a=read.actuator_current_a,
        guide_lifted=read.guide_lifted,
        beam_seated=read.beam_seated,
        lock_extended=read.lock_extended,
        lock_retracted=read.lock_retracted,
    )


def _silent(leds: int) -> LeaderState:
    return LeaderState(False, "I/O module silent", (0.0,) * leds, True, "down", "fault", 0.0, 0)


def make(context: NodeContext) -> LeaderNode:
    """The Leader's process."""
    return LeaderNode(context)
