"""Faults of wires, nodes and encoders that a campaign switches on and off at a simulated bus."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from common.canopen.frames import BUS_OFF, ERROR_FLAG, CanFrame


@dataclass
class BusFaults:
    """What is wrong with a bus; the default is nothing.

    ``silent`` nodes neither hear nor speak. ``truncated`` nodes' frames lose their last byte; ``replayed`` nodes'
    frames come twice. ``bus_off``: the master's controller reports bus-off, and nothing passes any more.
    ``injected`` frames are sent once, at the next opportunity.
    """

    silent: set[int] = field(default_factory=set)
    truncated: set[int] = field(default_factory=set)
    replayed: set[int] = field(default_factory=set)
    bus_off: bool = False
    injected: list[CanFrame] = field(default_factory=list)

    @property
    def active(self) -> bool:
        """Whether anything is to be done at all."""
        return bool(self.silent or self.truncated or self.replayed or self.bus_off or self.injected)

    def hears(self, node_id: int) -> bool:
        """Whether frames reach this node."""
        return not self.bus_off and node_id not in self.silent

    def spoil(self, frames: Iterable[CanFrame]) -> list[CanFrame]:
        """What of the nodes' frames arrives."""
        if self.bus_off:
            return [CanFrame(ERROR_FLAG | BUS_OFF, bytes(8))]
        arriving = list(self.injected)
        self.injected.clear()
        for frame in frames:
            node_id = frame.can_id & 0x7F
            if node_id in self.silent:
                continue
            kept = CanFrame(frame.can_id, frame.data[:-1]) if node_id in self.truncated else frame
            arriving += [kept] * (2 if node_id in self.replayed else 1)
        return arriving


@dataclass
class EncoderFault:
    """How an encoder lies: a jump of so many output units, its speed stuck at a value, its sign turned.

    A turned sign counts backwards from where the shaft is when it turns.
    """

    jump: float = 0.0
    stuck_at: float | None = None
    inverted: bool = False
    _turned_at: float | None = field(default=None, init=False)

    def read(self, position: float, velocity: float) -> tuple[float, float]:
        """What the drive believes, from position and speed of the output shaft."""
        seen = velocity if self.stuck_at is None else self.stuck_at
        if not self.inverted:
            return position + self.jump, seen
        if self._turned_at is None:
            self._turned_at = position
        return 2.0 * self._turned_at - position + self.jump, -seen
