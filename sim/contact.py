"""The trolley's front beam, the Leader's gravity guide and the handle between robot and trolley.

Quasi-static and along x_L: the beam is pushed through the handle's spring and damper, the guide's ramp resists
while it is lifted and falls behind the beam at its end, a stop lies behind it. A beam further off than the
lateral bound catches beside the guide. Not modelled: the trolley's yaw against the robot, its casters, and
impact; the trolley is rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

from sim.world_config import WorldConfig

GRAVITY_M_S2 = 9.81
_SEAT_PLAY_M = 0.004


@dataclass
class Contact:
    """State of the contact. ``beam_x_m`` is the beam in {L}; ``handle_force_n`` what the arms feel, pushing > 0."""

    world: WorldConfig
    beam_x_m: float
    gripped: bool = False
    seated: bool = False
    lifted: bool = False
    handle_force_n: float = 0.0

    def advance(
        self, handle_x_m: float, acceleration_m_s2: float, lateral_m: float, bound_m: float, dt_s: float
    ) -> None:
        """One step.

        Args:
            handle_x_m: where the gripped handle puts the beam without any force, in {L} [m].
            acceleration_m_s2: of the robot along x.
            lateral_m: the beam's lateral error.
            bound_m: beyond it the beam catches beside the guide.
            dt_s: the step, short against damping / stiffness.
        """
        if not self.gripped:
            self.handle_force_n = 0.0
            return
        world = self.world
        spring_n = world.handle_stiffness_n_m * (handle_x_m - self.beam_x_m)
        resistance_n = self._guide_force(abs(lateral_m) <= bound_m)
        speed = (spring_n - resistance_n) / world.handle_damping_n_s_m
        before = self.beam_x_m
        self.beam_x_m += speed * dt_s
        self._latch(before)
        rolling_n = world.rolling_resistance * world.trolley_mass_kg * GRAVITY_M_S2
        moving = min(1.0, abs(speed) / 0.01)
        carried_n = rolling_n * moving + world.trolley_mass_kg * acceleration_m_s2
        self.handle_force_n = spring_n + carried_n

    def regrip(self, handle_x_m: float) -> None:
        """The grippers close on a handle that stands where the robot holds it."""
        self.gripped = True
        if not self.seated:
            self.beam_x_m = handle_x_m

    def _guide_force(self, in_bounds: bool) -> float:
        world, x = self.world, self.beam_x_m
        begin, end = world.guide_ramp_m
        if self.seated:
            force = world.stop_stiffness_n_m * max(0.0, x - end)
            return force - world.stop_stiffness_n_m * max(0.0, end - _SEAT_PLAY_M - x)
        if x < begin:
            return 0.0
        if not in_bounds:
            return world.stop_stiffness_n_m * (x - begin)
        return world.guide_force_n * (x - begin) / (end - begin)

    def _latch(self, before_m: float) -> None:
        begin, end = self.world.guide_ramp_m
        if not self.seated and before_m < end <= self.beam_x_m:
            self.seated = True
        self.lifted = not self.seated and self.beam_x_m > begin + 0.02
