"""Faults of wiring, nodes and encoders, injected into a simulated bus."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from common.canopen.frames import BUS_OFF, ERROR_FLAG, CanFrame


@dataclass
class BusFaults:
    """Faults of a bus; none by default.

    ``silent`` nodes neither receive nor send. Frames of ``truncated`` nodes lose their last byte, frames of
    ``replayed`` nodes arrive twice. ``bus_off``: the master's controller reports bus-off, and no frame passes.
    ``injected`` frames are sent once, with the next frames.
    """

    silent: set[int] = field(default_factory=set)
    truncated: set[int] = field(default_factory=set)
    replayed: set[int] = field(default_factory=set)
    bus_off: bool = False
    injected: list[CanFrame] = field(default_factory=list)

    @property
    def active(self) -> bool:
        """Whether there is any fault."""
        return bool(self.silent or self.truncated or self.replayed or self.bus_off or self.injected)

    def reaches(self, node_id: int) -> bool:
        """Whether frames reach this node."""
        return not self.bus_off and node_id not in self.silent

    def spoil(self, frames: Iterable[CanFrame]) -> list[CanFrame]:
        """The frames that arrive, of those that the nodes send."""
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
    """Faults of an encoder: ``jump`` in output units, speed ``stuck_at`` a value, ``inverted`` sign.

    An inverted encoder counts backwards from where the shaft was when the sign changed.
    """

    jump: float = 0.0
    stuck_at: float | None = None
    inverted: bool = False
    _turned_at: float | None = field(default=None, init=False)

    def read(self, position: float, velocity: float) -> tuple[float, float]:
        """Position and speed as the drive reads them, from those of the output shaft."""
        seen = velocity if self.stuck_at is None else self.stuck_at
        if not self.inverted:
            return position + self.jump, seen
        if self._turned_at is None:
            self._turned_at = position
        return 2.0 * self._turned_at - position + self.jump, -seen
