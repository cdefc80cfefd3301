"""The trolley in hand, what it meets ahead, and how the next one comes.

Ahead of the first trolley is the Leader's guide, ahead of each further one the queue. Who fetches trolleys is no part
of this simulation: the next one is placed before the Follower's open grippers, as well as somebody would place it.
"""

from __future__ import annotations

from random import Random

from common.geometry import Pose2
from sim.physics.queue import Nested, Queue, stop_n
from sim.physics.trolley import RubberPad, Trolley
from sim.world_config import WorldConfig

TROLLEY_PITCH_M = 0.28


class Contact:
    """What the arms hold or held last, and the queue. ``handle_force_n``, their push, is set from outside.

    Args:
        world: masses, guide, floor.
        handle: pose of the first trolley's handle in {L}; its axes are the robot's.
        pads: that lie on the floor.
        gripped: the arms hold it.
        velocity: of its centre: m/s, m/s, rad/s.
        pitch_m: of nested trolleys.
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
        """Of the trolley in hand, in {L}."""
        return self.trolley.handle

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Of its centre: m/s, m/s, rad/s."""
        return self.trolley.velocity

    @property
    def beam_x_m(self) -> float:
        """Its front beam along {L}."""
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
            force_n: on the handle, in {L}.
            moment_n_m: about the handle.
            bound_m: a beam further off than this catches beside guide or mouth.
            dt_s: the step, short against the stops' period.
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

    def place_next(self, robot: Pose2, handle_x_m: float) -> None:
        """Hand the trolley that is home over to the queue; stand the next one before the robot's open grippers.

        Args:
            robot: {F} in {L}.
            handle_x_m: where the grippers expect the handle, in {F}.
        """
        draws, world = self._random, self.world
        home = self.trolley
        # on an uneven floor it rolls back a little once nobody pushes; the guide holds the first one
        rolled_m = draws.uniform(0.0, world.nest_play_m) if self.queue.members else 0.0
        self.queue.members.append(
            Nested(home.beam_x_m - rolled_m, home.beam_y_m, home.handle.theta_rad, home.mass_kg)
        )
        e_x, e_y, e_theta = (draws.uniform(-most, most) for most in world.place_error)
        handle = robot.compose(Pose2(handle_x_m + e_x, e_y, e_theta))
        casters = [draws.uniform(-world.caster_start_rad, world.caster_start_rad) for _ in range(2)]
        self.trolley = Trolley(world, handle, self._mass_kg(), casters_rad=casters)

    def _fill(self, pitch_m: float) -> None:
        """The trolleys that were docked before."""
        draws, world = self._random, self.world
        beam_x = world.guide_ramp_m[1]
        for _ in range(world.docked):
            beam_y = draws.uniform(-world.docked_error_m, world.docked_error_m)
            self.queue.members.append(Nested(beam_x, beam_y, 0.0, self._mass_kg()))
            beam_x -= pitch_m + draws.uniform(0.0, world.nest_play_m)
        self.queue.guide.seated = world.docked > 0

    def _mass_kg(self) -> float:
        return self.world.trolley_mass_kg + self._random.uniform(0.0, self.world.trolley_load_kg)
