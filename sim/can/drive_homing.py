"""Homing inside a simulated drive (CiA 402 mode 6): an incremental encoder that knows nothing until it is homed.

Methods 17 and 18 run into the negative or positive limit switch and take the edge at which it lets go, on the way
back; 35 and 37 take the place where the axis stands. Not modelled: index pulses, home switches, other methods.
"""

from __future__ import annotations

from typing import Literal

HomingPhase = Literal["idle", "search", "back", "done", "error"]
_TO_SWITCH = {17: -1.0, 18: 1.0}
_HERE = (35, 37)


class HomingRun:
    """All in counts of the motor's own direction. ``switch`` is where the limit switch trips."""

    def __init__(self, switch: float) -> None:
        self._switch = switch
        self._way = 0.0
        self.phase: HomingPhase = "idle"

    @property
    def running(self) -> bool:
        """Whether it moves."""
        return self.phase in ("search", "back")

    def start(self, method: int) -> None:
        """Bit 4 of the controlword rose."""
        self._way = _TO_SWITCH.get(method, 0.0)
        self.phase = "done" if method in _HERE else "search" if self._way else "error"

    def stop(self) -> None:
        """Bit 4 fell, or the drive left operation: what was found stays found."""
        if self.running:
            self.phase = "idle"

    def step(self, setpoint: float, measured: float, fast: float, slow: float, elapsed_s: float) -> float:
        """The next position set-point."""
        pressed = (measured - self._switch) * self._way >= 0.0
        if self.phase == "search" and pressed:
            self.phase = "back"
        elif self.phase == "back" and not pressed:
            self.phase = "done"
            return measured
        way, speed = (self._way, fast) if self.phase == "search" else (-self._way, slow)
        return setpoint + way * speed * elapsed_s
