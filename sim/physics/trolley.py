"""One trolley on the floor: a rigid body in the plane, moved by forces at its handle and met at its front beam.

It resists rolling and turning; its two pairs of casters swing round behind their direction of motion, and until then
push sideways; the edge of a rubber pad resists a wheel that climbs it. Not modelled: single casters, impact, tipping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from common.geometry import Pose2, wrap_angle
from sim.world_config import WorldConfig

GRAVITY_M_S2 = 9.81
_WHEEL_RADIUS_M = 0.06
AXLES_BEFORE_BEAM_M = (0.10, 0.75)
_TURNING_LEVER_M = 0.35
_YAW_RADIUS_M = 0.35
_CASTER_SLIP_M_S = 0.02
_STANDING_M_S = 1e-4


@dataclass(frozen=True)
class RubberPad:
    """A rubber pad across the path, by x in {L}: wheels roll harder on it and have to climb its edge."""

    begin_x_m: float
    end_x_m: float
    height_m: float
    rolling_resistance: float = 0.05

    def resistance(self, wheel_x_m: float) -> float:
        """Force against driving ahead, per axle load, on a wheel whose axle is at ``wheel_x_m``."""
        reach = math.sqrt(2 * _WHEEL_RADIUS_M * self.height_m - self.height_m**2)
        for edge, sign in ((self.begin_x_m, 1.0), (self.end_x_m, -1.0)):
            before = (edge - wheel_x_m) * sign
            if 0.0 < before < reach:
                return sign * before / math.sqrt(_WHEEL_RADIUS_M**2 - before**2)
        return self.rolling_resistance if self.begin_x_m <= wheel_x_m <= self.end_x_m else 0.0


@dataclass
class Trolley:
    """State of one trolley: pose of its handle, velocity of its centre, angles of its casters.

    Args:
        world: geometry and friction.
        handle: pose of the handle in {L}.
        mass_kg: load included.
        velocity: of its centre in {L}: m/s, m/s, rad/s.
        casters_rad: rolling direction of the front and the rear pair, 0 straight ahead.
    """

    world: WorldConfig
    handle: Pose2
    mass_kg: float
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    casters_rad: list[float] = field(default_factory=lambda: [0.0, 0.0])

    @property
    def beam_x_m(self) -> float:
        """Position of the front beam along x of {L}."""
        return self.x_ahead(self.world.handle_to_beam_m)

    @property
    def beam_y_m(self) -> float:
        """Lateral position of the front beam, along y of {L}."""
        return self.handle.y_m + self.world.handle_to_beam_m * math.sin(self.handle.theta_rad)

    @property
    def beam_speed_m_s(self) -> float:
        """Speed of the front beam along x of {L}."""
        v_x, _, w = self.velocity
        return v_x - w * self.world.handle_to_beam_m / 2 * math.sin(self.handle.theta_rad)

    def x_ahead(self, distance_m: float) -> float:
        """Position along x of {L} of a point ``distance_m`` ahead of the handle."""
        return self.handle.x_m + distance_m * math.cos(self.handle.theta_rad)

    def handle_velocity(self) -> tuple[float, float, float]:
        """Velocity of the handle in {L}: m/s, m/s, rad/s."""
        v_x, v_y, w = self.velocity
        to_handle = -self.world.handle_to_beam_m / 2
        c, s = math.cos(self.handle.theta_rad), math.sin(self.handle.theta_rad)
        return v_x - w * to_handle * s, v_y + w * to_handle * c, w

    def advance(
        self, force_n: tuple[float, float], moment_n_m: float, beam_n: float, pads: tuple[RubberPad, ...], dt_s: float
    ) -> None:
        """One step.

        Args:
            force_n: on the handle, x and y in {L}.
            moment_n_m: about the handle.
            beam_n: force on the front beam, against x of {L}.
            pads: rubber pads on the floor.
            dt_s: duration of the step.
        """
        arm = self.world.handle_to_beam_m / 2
        c, s = math.cos(self.handle.theta_rad), math.sin(self.handle.theta_rad)
        v_x, v_y, w = self.velocity
        climbing_n = self._pad_force(pads) if pads else 0.0
        side_n, twist_n_m = self._caster_force(c, s, dt_s)
        force_x = force_n[0] - beam_n - climbing_n * c - side_n * s
        force_y = force_n[1] - climbing_n * s + side_n * c
        # handle and beam lie at ∓arm from the centre
        moment = moment_n_m + arm * (force_n[0] * s - force_n[1] * c) + arm * beam_n * s + twist_n_m
        v_x += force_x / self.mass_kg * dt_s
        v_y += force_y / self.mass_kg * dt_s
        w += moment / (self.mass_kg * _YAW_RADIUS_M**2) * dt_s
        self.velocity = self._rub(v_x, v_y, w, dt_s)
        h_x, h_y, turn = self.handle_velocity()
        self.handle = Pose2(
            self.handle.x_m + h_x * dt_s,
            self.handle.y_m + h_y * dt_s,
            wrap_angle(self.handle.theta_rad + turn * dt_s),
        )

    def _caster_force(self, c: float, s: float, dt_s: float) -> tuple[float, float]:
        """Force to the trolley's left, and moment, of casters across their direction of motion; swing them round."""
        v_x, v_y, w = self.velocity
        ahead, left = c * v_x + s * v_y, c * v_y - s * v_x
        load = self.world.caster_friction * self.mass_kg * GRAVITY_M_S2 / len(AXLES_BEFORE_BEAM_M)
        half = self.world.handle_to_beam_m / 2
        total_n = total_n_m = 0.0
        for i, offset in enumerate(AXLES_BEFORE_BEAM_M):
            lever = half - offset
            sideways = left + w * lever
            speed = math.hypot(ahead, sideways)
            if speed < _STANDING_M_S:
                continue
            angle = self.casters_rad[i]
            slip = sideways * math.cos(angle) - ahead * math.sin(angle)
            push_n = -load * max(-1.0, min(1.0, slip / _CASTER_SLIP_M_S)) * math.cos(angle)
            total_n += push_n
            total_n_m += lever * push_n
            swing = speed / self.world.caster_trail_m * math.sin(math.atan2(sideways, ahead) - angle)
            self.casters_rad[i] = wrap_angle(angle + swing * dt_s)
        return total_n, total_n_m

    def _rub(self, v_x: float, v_y: float, w: float, dt_s: float) -> tuple[float, float, float]:
        """Rolling and turning resistance, which stop the trolley but never drive it."""
        loss = self.world.rolling_resistance * GRAVITY_M_S2 * dt_s
        speed = math.hypot(v_x, v_y)
        kept = max(0.0, 1.0 - loss / speed) if speed > 0.0 else 0.0
        turn_loss = loss * _TURNING_LEVER_M / _YAW_RADIUS_M**2
        return v_x * kept, v_y * kept, math.copysign(max(0.0, abs(w) - turn_loss), w)

    def _pad_force(self, pads: tuple[RubberPad, ...]) -> float:
        """Force against driving ahead; an edge never pushes a wheel that stands in front of it."""
        load = self.mass_kg * GRAVITY_M_S2 / len(AXLES_BEFORE_BEAM_M)
        total = 0.0
        for offset in AXLES_BEFORE_BEAM_M:
            wheel_x = self.x_ahead(self.world.handle_to_beam_m - offset)
            total += load * sum(pad.resistance(wheel_x) for pad in pads)
        return total if self.velocity[0] > 0.0 else min(total, 0.0)
