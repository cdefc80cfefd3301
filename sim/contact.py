"""The trolley on the floor, the Leader's gravity guide, and rubber pads that its wheels climb.

A rigid body in the plane, moved by forces at its handle: its wheels resist rolling and turning, a pad's edge resists
a wheel that climbs it. The guide's ramp resists the front beam while it is lifted and falls behind the beam at its
end, a stop lies behind it. A beam further off than the lateral bound catches beside the guide. Not modelled:
casters that must swing round, impact, and the guide's own hold sideways.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from common.geometry import Pose2, wrap_angle
from sim.world_config import WorldConfig

GRAVITY_M_S2 = 9.81
_SEAT_PLAY_M = 0.004
_STOP_DAMPING_N_S_M = 500.0
_WHEEL_RADIUS_M = 0.06
_AXLES_BEFORE_BEAM_M = (0.10, 0.75)
_TURNING_LEVER_M = 0.35
_YAW_RADIUS_M = 0.35


@dataclass(frozen=True)
class RubberPad:
    """A pad across the way, by x in {L}: its wheels roll harder on it and have to climb its edge."""

    begin_x_m: float
    end_x_m: float
    height_m: float
    rolling_resistance: float = 0.05

    def resistance(self, wheel_x_m: float) -> float:
        """Force against driving ahead, by an axle's load, of a wheel whose axle is at ``wheel_x_m``."""
        reach = math.sqrt(2 * _WHEEL_RADIUS_M * self.height_m - self.height_m**2)
        for edge, sign in ((self.begin_x_m, 1.0), (self.end_x_m, -1.0)):
            before = (edge - wheel_x_m) * sign
            if 0.0 < before < reach:
                return sign * before / math.sqrt(_WHEEL_RADIUS_M**2 - before**2)
        return self.rolling_resistance if self.begin_x_m <= wheel_x_m <= self.end_x_m else 0.0


@dataclass
class Contact:
    """The trolley and what it touches. ``handle_force_n``, the arms' push along the chassis, is set from outside.

    Args:
        world: masses, guide, floor.
        handle: pose of the handle in {L} at the start; the trolley's axes are the robot's.
        pads: that lie on the floor.
    """

    world: WorldConfig
    handle: Pose2
    pads: tuple[RubberPad, ...] = ()
    gripped: bool = False
    seated: bool = False
    lifted: bool = False
    handle_force_n: float = 0.0
    velocity: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))

    @property
    def beam_x_m(self) -> float:
        """The front beam along {L}."""
        return self._x_ahead(self.world.handle_to_beam_m)

    @property
    def beam_y_m(self) -> float:
        """The front beam's lateral place in {L}."""
        return self.handle.y_m + self.world.handle_to_beam_m * math.sin(self.handle.theta_rad)

    def handle_velocity(self) -> tuple[float, float, float]:
        """Velocity of the handle in {L}: m/s, m/s, rad/s."""
        v_x, v_y, w = self.velocity
        to_handle = -self.world.handle_to_beam_m / 2
        c, s = math.cos(self.handle.theta_rad), math.sin(self.handle.theta_rad)
        return v_x - w * to_handle * s, v_y + w * to_handle * c, w

    def advance(self, force_n: tuple[float, float], moment_n_m: float, bound_m: float, dt_s: float) -> None:
        """One step.

        Args:
            force_n: on the handle, in {L}.
            moment_n_m: about the handle.
            bound_m: a beam further off than this catches beside the guide.
            dt_s: the step, short against the stop's period.
        """
        world, before = self.world, self.beam_x_m
        arm = world.handle_to_beam_m / 2
        c, s = math.cos(self.handle.theta_rad), math.sin(self.handle.theta_rad)
        v_x, v_y, w = self.velocity
        guide_n = self._guide_force(abs(self.beam_y_m) <= bound_m, v_x - w * arm * s)
        climbing_n = self._pad_force()
        force_x = force_n[0] - guide_n - climbing_n * c
        force_y = force_n[1] - climbing_n * s
        # handle and beam lie at ∓arm from the centre
        moment = moment_n_m + arm * (force_n[0] * s - force_n[1] * c) + arm * guide_n * s
        mass = world.trolley_mass_kg
        v_x += force_x / mass * dt_s
        v_y += force_y / mass * dt_s
        w += moment / (mass * _YAW_RADIUS_M**2) * dt_s
        v_x, v_y, w = self._rub(v_x, v_y, w, dt_s)
        self.velocity = v_x, v_y, w
        h_x, h_y, _ = self.handle_velocity()
        self.handle = Pose2(
            self.handle.x_m + h_x * dt_s, self.handle.y_m + h_y * dt_s, wrap_angle(self.handle.theta_rad + w * dt_s)
        )
        self._latch(before)

    def _rub(self, v_x: float, v_y: float, w: float, dt_s: float) -> tuple[float, float, float]:
        """Rolling and turning resistance, which stop the trolley but never drive it."""
        loss = self.world.rolling_resistance * GRAVITY_M_S2 * dt_s
        speed = math.hypot(v_x, v_y)
        kept = max(0.0, 1.0 - loss / speed) if speed > 0.0 else 0.0
        turn_loss = loss * _TURNING_LEVER_M / _YAW_RADIUS_M**2
        return v_x * kept, v_y * kept, math.copysign(max(0.0, abs(w) - turn_loss), w)

    def _pad_force(self) -> float:
        """Force against driving ahead; a wheel that stands before an edge is not pushed by it."""
        if not self.pads:
            return 0.0
        load = self.world.trolley_mass_kg * GRAVITY_M_S2 / len(_AXLES_BEFORE_BEAM_M)
        total = 0.0
        for offset in _AXLES_BEFORE_BEAM_M:
            wheel_x = self._x_ahead(self.world.handle_to_beam_m - offset)
            total += load * sum(pad.resistance(wheel_x) for pad in self.pads)
        return total if self.velocity[0] > 0.0 else min(total, 0.0)

    def _guide_force(self, in_bounds: bool, speed_m_s: float) -> float:
        """Against x_L, on the beam."""
        world, x = self.world, self.beam_x_m
        begin, end = world.guide_ramp_m
        if self.seated:
            if end - _SEAT_PLAY_M <= x <= end:
                return 0.0
            edge = end if x > end else end - _SEAT_PLAY_M
            return world.stop_stiffness_n_m * (x - edge) + _STOP_DAMPING_N_S_M * speed_m_s
        if x < begin:
            return 0.0
        if not in_bounds:
            return max(0.0, world.stop_stiffness_n_m * (x - begin) + _STOP_DAMPING_N_S_M * speed_m_s)
        return world.guide_force_n * (x - begin) / (end - begin)

    def _latch(self, before_m: float) -> None:
        begin, end = self.world.guide_ramp_m
        if not self.seated and before_m < end <= self.beam_x_m:
            self.seated = True
        self.lifted = not self.seated and self.beam_x_m > begin + 0.02

    def _x_ahead(self, distance_m: float) -> float:
        """Place along {L} of a point of the trolley ahead of its handle."""
        return self.handle.x_m + distance_m * math.cos(self.handle.theta_rad)
