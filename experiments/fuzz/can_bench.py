"""A node on a simulated CAN bus: started, listened to until there are genuine frames, stopped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from common.canopen.frames import CanFrame
from common.node import Node
from common.timing import SteppedClock
from sim.can.stepped_bus import SteppedBus, SteppedChannel


class CanBench(ABC):
    """Runs the node for ``listened_cycles``, so that :attr:`genuine` has the frames which a mutation starts from."""

    def __init__(self, node: Node, channel: SteppedChannel, clock: SteppedClock, listened_cycles: int) -> None:
        self._node, self._channel, self._clock = node, channel, clock
        self._listened_cycles = listened_cycles
        self.genuine: list[CanFrame] = []

    @abstractmethod
    def step(self, frames: Sequence[CanFrame]) -> str:
        """One cycle of the node with these frames on its bus; the limit that broke, or ""."""

    def __enter__(self) -> Self:
        self._channel.__enter__()
        self._node.start(self._clock.now_ns())
        tap = SteppedBus(self._channel.name)
        for _ in range(self._listened_cycles):
            self.step([])
        self.genuine = list(tap.inbox)
        tap.shutdown()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._node.stop(self._clock.now_ns())
        self._channel.__exit__()
