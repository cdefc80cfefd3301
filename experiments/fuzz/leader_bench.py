"""The Leader as a node on a simulated bus, asked to lock and never to unlock, and its limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random

from common.canopen.frames import CanFrame
from common.channels import FOLLOWER_SUMMARY, LED_REQUEST, LOCK_REQUEST
from common.config import Config, default_config_path
from common.messages import Answer, LeaderState, LedRequest, LockRequest, MessageError
from common.node import Inbox, NodeContext, Outbox
from common.request_desk import RequestDesk
from common.timing import NS_PER_MS, SteppedClock
from experiments.fuzz.can_bench import CanBench
from experiments.fuzz.messages import Mutator
from leader.node import LeaderNode
from sim.can.nodes import LeaderBus
from sim.can.stepped_bus import SteppedChannel

_CYCLE_NS = 20 * NS_PER_MS
_LISTENED_CYCLES = 10
_SPARE_A = 1e-3  # a set-point is a whole number of mA
_SWITCHED, _ASKED, _MALFORMED = 0.02, 0.05, 0.05


class LeaderBench(CanBench):
    """Requests, switches and the Follower's summary around the frames that :meth:`step` adds to the bus."""

    def __init__(self, config: Config, random: Random, folder: Path) -> None:
        stepped = config.leader_can.bus.model_copy(update={"interface": "stepped", "channel": "fuzz-leader"})
        can = config.leader_can.model_copy(update={"bus": stepped})
        self._config = config.model_copy(update={"leader_can": can, "state_directory": str(folder)})
        self._random = random
        clock = SteppedClock()
        path = default_config_path()
        self._robot = LeaderBus.build(can, path)
        channel = SteppedChannel("fuzz-leader", self._robot.bus, clock.now_ns)
        node = LeaderNode(NodeContext(self._config, path, folder, 1, clock))
        super().__init__(node, channel, clock, _LISTENED_CYCLES)
        self._inbox = Inbox(self._clock.boot_id)
        self._outbox = Outbox("leader", 1, self._clock.boot_id)
        self._station = Outbox("station", 2, self._clock.boot_id)
        self._desk = RequestDesk(
            self._clock.boot_id, lambda channel, answer: self._outbox.pack(channel, answer, self._clock.now_ns())
        )
        self._mutator = Mutator(random, self._clock.boot_id)
        self._number = 0
        self._lock = ""

    @property
    def ready(self) -> bool:
        """Whether the lock is not in a fault."""
        return self._lock != "fault"

    def step(self, frames: Sequence[CanFrame]) -> str:
        """See :class:`CanBench`."""
        self._clock.advance_to(self._clock.now_ns() + _CYCLE_NS)
        self._robot.bus.faults.injected += frames
        if self._random.random() < _SWITCHED:
            self._robot.set_switches(*(self._random.random() < 0.5 for _ in range(4)))
        self._channel.tick()
        self._ask()
        self._inbox.begin_step()
        locks = []
        for channel, message in self._node.step(self._clock.now_ns(), self._inbox):
            payload = self._outbox.pack(channel, message, self._clock.now_ns())
            if isinstance(message, Answer):
                self._desk.settle(message, payload)
            elif isinstance(message, LeaderState):
                locks.append(message.lock)
        return self._broken(locks)

    def _ask(self) -> None:
        random, now_ns = self._random, self._clock.now_ns()
        self._number += 1
        identity = f"request-{self._number}"
        if random.random() < _ASKED:
            action = random.choice(("lock", "confirm", "reset", "count"))
            lock = LockRequest(identity, 5000, action, random.randrange(100), confirmed=action == "count")  # type: ignore[arg-type] # chosen of its values
            self._admit(self._station.pack(LOCK_REQUEST, lock, now_ns), lock=True)
        if random.random() < _ASKED:
            led = LedRequest(identity, 5000, random.choice((None, 0, 3, 11)), random.choice((None, 0.0, 1.0, 5.0)))
            self._admit(self._station.pack(LED_REQUEST, led, now_ns), lock=False)
        if random.random() < _MALFORMED:
            payload = self._mutator.payload(FOLLOWER_SUMMARY, now_ns)
            self._inbox.put_state(FOLLOWER_SUMMARY, payload, now_ns)
            self._admit(payload, lock=True)

    def _admit(self, payload: bytes, lock: bool) -> None:
        channel = LOCK_REQUEST if lock else LED_REQUEST
        try:
            request = self._desk.admit(channel, payload, self._clock.now_ns(), lambda _reply: None)
        except MessageError:
            return
        if request is not None and not self._inbox.put_request(channel, request):
            self._desk.withdraw(request.message.id)

    def _broken(self, locks: Sequence[str]) -> str:
        most_a = self._config.leader.led_max_current_a + _SPARE_A
        if any(self._robot.led_setpoint_a(led) > most_a for led in range(len(self._config.leds.positions_m))):
            return "LED current beyond its maximum"
        for lock in locks:
            before, self._lock = self._lock, lock
            if before == "locked" and lock == "opening":
                return "the lock opens without a request"
        return ""
