"""Homing inside a simulated drive (CiA 402 mode 6), for incremental encoders, whose position is unknown until then.

Methods 17 and 18 run into the negative or positive limit switch and home on its edge while backing off; 35 and 37
home at the current position. Not modelled: index pulses, home switches, other methods.
"""

from __future__ import annotations

from typing import Literal

HomingPhase = Literal["idle", "search", "back", "done", "error"]
_TO_SWITCH = {17: -1.0, 18: 1.0}
_HERE = (35, 37)


class HomingRun:
    """All in counts, in the motor's own direction. ``switch`` is where the limit switch trips."""

    def __init__(self, switch: float) -> None:
        self._switch = switch
        self._direction = 0.0
        self.phase: HomingPhase = "idle"

    @property
    def running(self) -> bool:
        """Whether it moves."""
        return self.phase in ("search", "back")

    def start(self, method: int) -> None:
        """Bit 4 of the controlword rose: begin homing by ``method`` (6098h)."""
        self._direction = _TO_SWITCH.get(method, 0.0)
        self.phase = "done" if method in _HERE else "search" if self._direction else "error"

    def stop(self) -> None:
        """Bit 4 fell, or the drive left operation: stop; a home already found stays valid."""
        if self.running:
            self.phase = "idle"

    def step(self, setpoint: float, measured: float, fast: float, slow: float, elapsed_s: float) -> float:
        """The next position set-point [counts].

        Args:
            setpoint, measured: current position set-point and measured position [counts].
            fast, slow: speeds towards the switch and back from it [counts/s].
            elapsed_s: time since the last step.
        """
        pressed = (measured - self._switch) * self._direction >= 0.0
        if self.phase == "search" and pressed:
            self.phase = "back"
        elif self.phase == "back" and not pressed:
            self.phase = "done"
            return measured
        direction, speed = (self._direction, fast) if self.phase == "search" else (-self._direction, slow)
        return setpoint + direction * speed * elapsed_s
