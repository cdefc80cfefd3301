"""The trolley in hand, what it meets ahead, and how the next one comes.

Ahead of the first trolley is the Leader's guide, ahead of each further one the queue. Not modelled: how trolleys are
fetched; the next one appears in front of the Follower's open grippers, as accurately as an operator would place it.
"""

from __future__ import annotations

from random import Random

from common.geometry import Pose2
from sim.physics.queue import Nested, Queue, stop_n
from sim.physics.trolley import RubberPad, Trolley
from sim.world_config import WorldConfig

TROLLEY_PITCH_M = 0.28


class Contact:
    """The trolley that the arms hold or held last, and the queue. The caller sets ``handle_force_n``, the arms' push.

    Args:
        world: masses, guide, floor.
        handle: pose of the first trolley's handle in {L}; its axes are those of {F} while it is held.
        pads: rubber pads on the floor.
        gripped: whether the arms hold it.
        velocity: of its centre in {L}: m/s, m/s, rad/s.
        pitch_m: distance from one nested trolley to the next.
    """

    def __init__(
        self,
        world: WorldConfig,
        handle: Pose2,
        pads: tuple[RubberPad, ...] = (),
        gripped: bool = False,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        pitch_m: float = TROLLEY_PITCH_M,
    ) -> None:
        self.world, self.pads, self.gripped = world, pads, gripped
        self.handle_force_n = 0.0
        self.queue = Queue(world, pitch_m)
        # metres before it is home at which something blocks the trolley in hand: a fault to inject
        self.jam_m: float | None = None
        self._random = Random(f"{world.seed} trolleys")
        self._fill(pitch_m)
        self.trolley = Trolley(world, handle, self._mass_kg(), velocity)

    @property
    def handle(self) -> Pose2:
        """Pose in {L} of the handle of the trolley in hand."""
        return self.trolley.handle

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Of its centre: m/s, m/s, rad/s."""
        return self.trolley.velocity

    @property
    def beam_x_m(self) -> float:
        """Its front beam along x of {L}."""
        return self.trolley.beam_x_m

    @property
    def seated(self) -> bool:
        """The first trolley's beam is in the guide."""
        return self.queue.guide.seated

    @property
    def lifted(self) -> bool:
        """The guide is lifted by a beam below it."""
        return self.queue.guide.lifted

    @property
    def home(self) -> bool:
        """The trolley in hand stands in the guide or in the queue."""
        return self.queue.is_home(self.trolley.beam_x_m)

    def handle_velocity(self) -> tuple[float, float, float]:
        """Velocity of the handle in {L}: m/s, m/s, rad/s."""
        return self.trolley.handle_velocity()

    def advance(self, force_n: tuple[float, float], moment_n_m: float, bound_m: float, dt_s: float) -> None:
        """One step.

        Args:
            force_n: on the handle, x and y in {L}.
            moment_n_m: about the handle.
            bound_m: lateral error beyond which the beam hits the edge of guide or mouth.
            dt_s: the step, short against the period of the stops.
        """
        trolley, queue = self.trolley, self.queue
        first = queue.members[0].beam_x_m if queue.members else trolley.beam_x_m
        speed = trolley.beam_speed_m_s
        met_n = queue.meet_n(trolley.beam_x_m, trolley.beam_y_m, speed, bound_m)
        jam_n = 0.0
        if self.jam_m is not None:
            depth = trolley.beam_x_m - (queue.mouth_x_m() - self.jam_m)
            jam_n = stop_n(self.world.stop_stiffness_n_m, depth, speed)
        trolley.advance(force_n, moment_n_m, met_n + jam_n, self.pads, dt_s)
        if queue.members:
            queue.advance(met_n, dt_s)
        queue.guide.latch(first, queue.members[0].beam_x_m if queue.members else trolley.beam_x_m)

    def place_next(self, follower_in_leader: Pose2, handle_x_m: float) -> None:
        """Add the docked trolley to the queue; place the next one in front of the Follower's open grippers.

        Args:
            follower_in_leader: pose of {F} in {L}.
            handle_x_m: where the grippers expect the handle, along x of {F}.
        """
        draws, world = self._random, self.world
        home = self.trolley
        # on an uneven floor it rolls back a little once it is not pushed; the guide holds the first one
        rolled_m = draws.uniform(0.0, world.nest_play_m) if self.queue.members else 0.0
        self.queue.members.append(
            Nested(home.beam_x_m - rolled_m, home.beam_y_m, home.handle.theta_rad, home.mass_kg)
        )
        e_x, e_y, e_theta = (draws.uniform(-most, most) for most in world.place_error)
        handle = follower_in_leader.compose(Pose2(handle_x_m + e_x, e_y, e_theta))
        casters = [draws.uniform(-world.caster_start_rad, world.caster_start_rad) for _ in range(2)]
        self.trolley = Trolley(world, handle, self._mass_kg(), casters_rad=casters)

    def _fill(self, pitch_m: float) -> None:
        """Place the trolleys that were docked before."""
        draws, world = self._random, self.world
        beam_x = world.guide_ramp_m[1]
        for _ in range(world.docked):
            beam_y = draws.uniform(-world.docked_error_m, world.docked_error_m)
            self.queue.members.append(Nested(beam_x, beam_y, 0.0, self._mass_kg()))
            beam_x -= pitch_m + draws.uniform(0.0, world.nest_play_m)
        self.queue.guide.seated = world.docked > 0

    def _mass_kg(self) -> float:
        return self.world.trolley_mass_kg + self._random.uniform(0.0, self.world.trolley_load_kg)
