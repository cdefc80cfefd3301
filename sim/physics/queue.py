"""The trolleys that stand nested behind the Leader's guide, and the guide itself: a chain along {L}'s x.

The guide's ramp resists the first trolley's beam while it is lifted and falls behind it at its end, before a stop.
Each further trolley slides into the one ahead against friction up to a stop, with play in between: a queue must be
pushed shut. Nested trolleys push, but never pull, each other. Not modelled: centring by the mouth, lateral motion
of nested trolleys.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.physics.trolley import GRAVITY_M_S2
from sim.world_config import WorldConfig

STOP_DAMPING_N_S_M = 500.0
SEAT_PLAY_M = 0.004
_LIFTED_AFTER_M = 0.02
_HOME_M = 0.03


@dataclass
class Guide:
    """The guide: lifted by a beam that passes below, down again behind a seated beam."""

    world: WorldConfig
    seated: bool = False
    lifted: bool = False

    def force_n(self, beam_x_m: float, speed_m_s: float, in_bounds: bool) -> float:
        """Force against x of {L} on the first trolley's beam; out of bounds the beam hits the guide's edge."""
        world, x = self.world, beam_x_m
        begin, end = world.guide_ramp_m
        if self.seated:
            if end - SEAT_PLAY_M <= x <= end:
                return 0.0
            edge = end if x > end else end - SEAT_PLAY_M
            return world.stop_stiffness_n_m * (x - edge) + STOP_DAMPING_N_S_M * speed_m_s
        if x < begin:
            return 0.0
        if not in_bounds:
            return stop_n(world.stop_stiffness_n_m, x - begin, speed_m_s)
        return world.guide_force_n * (x - begin) / (end - begin)

    def latch(self, before_m: float, beam_x_m: float) -> None:
        """Update the guide from the beam, which was at ``before_m`` one step ago."""
        begin, end = self.world.guide_ramp_m
        if not self.seated and before_m < end <= beam_x_m:
            self.seated = True
        self.lifted = not self.seated and beam_x_m > begin + _LIFTED_AFTER_M


@dataclass
class Nested:
    """A trolley of the queue: its beam in {L}, its heading, its mass, its speed along x."""

    beam_x_m: float
    beam_y_m: float
    theta_rad: float
    mass_kg: float
    speed_m_s: float = 0.0


class Queue:
    """Trolleys behind the guide, in the order of docking."""

    def __init__(self, world: WorldConfig, pitch_m: float) -> None:
        self._world, self._pitch_m = world, pitch_m
        self.guide = Guide(world)
        self.members: list[Nested] = []

    def __len__(self) -> int:
        return len(self.members)

    def handles(self) -> tuple[tuple[float, float, float], ...]:
        """Poses of the handles in {L}: x, y [m], heading [rad]."""
        length = self._world.handle_to_beam_m
        return tuple(
            (
                member.beam_x_m - length * math.cos(member.theta_rad),
                member.beam_y_m - length * math.sin(member.theta_rad),
                member.theta_rad,
            )
            for member in self.members
        )

    def mouth_x_m(self) -> float:
        """Where the next trolley's beam stops: in the guide, or in the last trolley at its present position."""
        return self.members[-1].beam_x_m - self._pitch_m if self.members else self._world.guide_ramp_m[1]

    def is_home(self, beam_x_m: float) -> bool:
        """Whether a beam at this position is in the guide or in the last trolley."""
        return self.guide.seated if not self.members else beam_x_m >= self.mouth_x_m() - _HOME_M

    def meet_n(self, beam_x_m: float, beam_y_m: float, speed_m_s: float, bound_m: float) -> float:
        """Force of guide or last trolley on the beam of the pushed trolley [N], against x of {L}.

        Args:
            beam_x_m, beam_y_m: position of the beam in {L}.
            speed_m_s: of the beam along x of {L}.
            bound_m: lateral error beyond which the beam hits the edge of guide or mouth.
        """
        if not self.members:
            return self.guide.force_n(beam_x_m, speed_m_s, abs(beam_y_m) <= bound_m)
        last, world = self.members[-1], self._world
        depth = beam_x_m - (self.mouth_x_m() - world.nest_m)
        closing = speed_m_s - last.speed_m_s
        if depth < 0.0:
            return 0.0
        if abs(beam_y_m - last.beam_y_m) > bound_m:
            return stop_n(world.nest_stiffness_n_m, depth, closing)
        rubbing = world.nest_force_n * min(1.0, depth / world.nest_m) * max(-1.0, min(1.0, closing / 0.005))
        return rubbing + stop_n(world.nest_stiffness_n_m, depth - world.nest_m, closing)

    def advance(self, pushed_n: float, dt_s: float) -> None:
        """One step of all nested trolleys; ``pushed_n`` pushes the last of them ahead."""
        members, world = self.members, self._world
        for i in range(len(members) - 1, -1, -1):
            member = members[i]
            if i:
                ahead = members[i - 1]
                gap = ahead.beam_x_m - self._pitch_m - member.beam_x_m
                resisted = stop_n(world.nest_stiffness_n_m, -gap, member.speed_m_s - ahead.speed_m_s)
            else:
                resisted = self.guide.force_n(member.beam_x_m, member.speed_m_s, in_bounds=True)
            speed = member.speed_m_s + (pushed_n - resisted) / member.mass_kg * dt_s
            loss = world.rolling_resistance * GRAVITY_M_S2 * dt_s
            member.speed_m_s = math.copysign(max(0.0, abs(speed) - loss), speed)
            member.beam_x_m += member.speed_m_s * dt_s
            pushed_n = resisted


def stop_n(stiffness_n_m: float, depth_m: float, speed_m_s: float) -> float:
    """Force of a stop that is compressed by ``depth_m``; it never pulls."""
    return max(0.0, stiffness_n_m * depth_m + STOP_DAMPING_N_S_M * speed_m_s) if depth_m > 0.0 else 0.0
