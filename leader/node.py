"""Leader process: LED array, guide and lock over CAN, heartbeat."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from common.canopen.bus import BusLostError
from common.channels import FOLLOWER_SUMMARY, LEADER_STATE, LED_REQUEST, LOCK_REQUEST
from common.errors import DeviceError
from common.files.writer import BackgroundWriter, state_directory
from common.messages import Answer, LeaderState
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from leader.io_module import LeaderIo, ModuleReading
from leader.queue_file import QUEUE_FILE, content, read
from leader.sequence import IoInputs, LeaderSequence

_STEPS_PER_HEARTBEAT = 5
_REOPEN_NS = NS_PER_S
_log = logging.getLogger("leader")


class LeaderNode(Node):
    """Exchanges with the I/O module at 50 Hz; its state at 10 Hz, and at once when it changes, is the heartbeat."""

    name = "leader"
    inputs = (FOLLOWER_SUMMARY,)
    outputs = (LEADER_STATE,)
    serves = (LOCK_REQUEST, LED_REQUEST)
    trigger = Trigger(period_ns=NS_PER_S // 50)

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._queue_path = state_directory(config.state_directory, context.runtime) / QUEUE_FILE
        kept = read(self._queue_path)
        if kept.warning:
            _log.warning("%s", kept.warning)
        self._kept = kept.count
        self._sequence = LeaderSequence(config.leader, config.leds, kept.count)
        self._writer = context.device("writer", BackgroundWriter(limit=4))
        self._write_fault = ""
        io = LeaderIo(config.leader_can, context.config_path, len(config.leds.positions_m))
        self._io = context.device("io", io)
        self._published: LeaderState | None = None
        self._steps = 0
        self._reopen_ns: int | None = None

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Bring the I/O module up."""
        self._io.open()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """One exchange with the module and one step of the sequence."""
        locks, leds = inputs.requests(LOCK_REQUEST), inputs.requests(LED_REQUEST)
        reading = self._exchange(now_ns)
        if reading is None:
            answers: list[Output] = [(LOCK_REQUEST, _unreachable(received.message.id)) for received in locks]
            answers += [(LED_REQUEST, _unreachable(received.message.id)) for received in leds]
            return [*self._heartbeat(_silent(len(self._sequence.outputs.led_current_a), self._kept)), *answers]
        self._sequence.set_follower(inputs.fresh(FOLLOWER_SUMMARY, now_ns))
        for lock in locks:
            self._sequence.request(lock.message, lock.receipt_ns, now_ns, reading)
        for led in leds:
            self._sequence.led_request(led.message, led.receipt_ns, now_ns)
        state, due = self._sequence.step(now_ns, reading)
        self._keep(state.queue)
        outputs = self._heartbeat(state)
        outputs += [(LOCK_REQUEST, answer) for answer in due.lock]
        outputs += [(LED_REQUEST, answer) for answer in due.led]
        return outputs

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Stop the actuator; the LEDs stay as they are."""
        self._io.close()
        self._writer.close()
        return ()

    def _keep(self, queue: int | None) -> None:
        """Write the count when it changed, beside the loop."""
        if queue != self._kept:
            self._kept = queue
            self._writer.replace(self._queue_path, content(queue))
        if self._writer.fault != self._write_fault:
            self._write_fault = self._writer.fault
            if self._write_fault:
                _log.warning("the number of trolleys cannot be saved: %s", self._write_fault)

    def _exchange(self, now_ns: int) -> IoInputs | None:
        """What the module reads; None while it cannot be reached."""
        if self._reopen_ns is not None and not self._reopened(now_ns):
            return None
        outputs = self._sequence.outputs
        self._io.set_led_currents(outputs.led_current_a)
        self._io.drive_actuator(outputs.actuator)
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
    return state.ready, state.cause, state.led_fault, state.led_derated, state.guide, state.lock, state.queue


def _io_inputs(read: ModuleReading) -> IoInputs:
    return IoInputs(
        led_current_a=read.led_current_a,
        actuator_current_a=read.actuator_current_a,
        guide_lifted=read.guide_lifted,
        beam_seated=read.beam_seated,
        lock_extended=read.lock_extended,
        lock_retracted=read.lock_retracted,
    )


def _unreachable(request_id: str) -> Answer:
    return Answer(request_id, "refused", "I/O module silent")


def _silent(leds: int, queue: int | None) -> LeaderState:
    """Without its I/O module: everything that it would measure is at its careful value."""
    return LeaderState(
        ready=False,
        cause="I/O module silent",
        led_current_a=(0.0,) * leds,
        led_fault=True,
        guide="down",
        lock="fault",
        actuator_current_a=0.0,
        queue=queue,
    )


def make(context: NodeContext) -> LeaderNode:
    """The Leader's process."""
    return LeaderNode(context)
