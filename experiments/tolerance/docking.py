"""One docking of a robot that is not as configured: the robot's estimator, controller and supervisor, from its spots.

Perception is the robot's but for the search of spots in pixels: the tracker's test whether they agree, the fit, the
levelling. Everything after it is the code of the processes, at their rates. Each docking begins with a trolley in the
grippers and ends when the supervisor calls it arrived, or why not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.config import Config
from common.docking_errors import DockingError, docked_error
from common.frames.ring import Image
from common.geometry import Array, Pose2
from common.messages import ArmState, DockingState, DockRequest, Drives, Frame, LeaderState, Mission
from common.messages.fields import LockState
from common.timing import NS_PER_S
from experiments.tolerance.world import TrueRobot
from follower.controller.docking import DockingController
from follower.controller.methods import make_method
from follower.estimator.detection import Detection
from follower.estimator.pipeline import Perception
from follower.estimator.state import StateEstimator
from follower.estimator.tracking import Followed
from follower.model.taught_geometry import TaughtGeometry
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.sequence import DockingSequence

FRAME_HZ = 60
FRAMES_PER_COMMAND = 3
LONGEST_S = 240.0  # with all retries; the supervisor ends every approach much sooner
_BEGUN = frozenset({"staging", "acquire", "search", "approach"})
Watch = Callable[[int, DockingState, TrueRobot], None]
_ARMS = ArmState(5.0, False, False, True, False)


class SpotPerception(Perception):
    """Perception of spots that are known to be the LEDs, in :attr:`pixels`, (n, 2), NaN where not seen."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.pixels: Array = np.full((len(config.leds.points), 2), np.nan)
        self._start = np.append(config.docking.goal(8).as_array(), (0.0, 0.0))

    def process(
        self,
        image: Image | None,  # noqa: ARG002 - the spots are given
        frame_sequence: int,
        capture_ns: int,
        twist: tuple[float, float],  # noqa: ARG002
        predicted: Pose2 | None = None,
        light: float = 1.0,  # noqa: ARG002
    ) -> Detection:
        """As :meth:`Perception.process`, from the given spots.

        Args:
            image, twist, light: not used.
            frame_sequence: the camera's count.
            capture_ns: middle of the exposure.
            predicted: pose of {L} in {F} as the observer expects it.
        """
        unseen = np.isnan(self.pixels)
        features = np.where(unseen, np.nan, self._lens.to_normalised(np.where(unseen, 0.0, self.pixels)))
        nothing = Detection(frame_sequence, capture_ns, False, "not_identified", features * np.nan, features * np.nan)
        if predicted is not None:
            self._start[:3] = predicted.as_array()
        agreed = self._tracker.agreed(features, self._start) if not unseen.any() else None
        if agreed is None:
            return replace(nothing, cause="few_leds" if unseen.any() else "residual")
        kept, fitted = agreed
        self._start = fitted.state
        return self._report(
            nothing, Followed(kept, fitted, np.ones(len(kept)), np.ones(len(kept)), len(kept)), confirmed=True
        )


@dataclass(frozen=True)
class ApproachEnd:
    """How an approach ended: ``cause`` is empty where it arrived; ``error`` is true, against the goal as meant."""

    cause: str
    error: DockingError
    seconds: float
    residual_px: float


class Robot:
    """The Follower's processes between spots and command, on the geometry that they go by."""

    def __init__(self, config: Config, taught: TaughtGeometry | None, trolley: int) -> None:
        self._config = config if taught is None else taught.config
        self._trolley = trolley
        self.perception = SpotPerception(self._config)
        self._estimator = StateEstimator(self._config, self.perception)
        self._controller = DockingController(self._config, make_method(self._config))
        self.sequence = DockingSequence(self._config, 1000, None if taught is None else taught.goals)
        self.mission: Mission | None = None
        self.state: DockingState | None = None
        self._asked = False
        self._frames = 0

    def step(self, now_ns: int, world: TrueRobot, light_ns: int) -> tuple[float, float] | None:
        """One frame; a command on every third.

        Args:
            now_ns: the time.
            world: that it looks at and drives in.
            light_ns: stamp of the image.
        """
        self._frames += 1
        camera = self._config.camera
        self.perception.pixels = world.pixels()
        size = camera.width_px, camera.height_px
        frame = Frame(self._frames, 0, light_ns, "spots", *size, camera.exposure_us, camera.gain)
        self.state = self._estimator.step(frame, _NO_PIXELS, world.wheels, None)
        if self._frames % FRAMES_PER_COMMAND:
            return None
        self._supervise(now_ns, world)
        twist = self._controller.step(now_ns, self.state, self.mission, world.wheels)
        self._controller.commit(twist)
        return twist.v_m_s, twist.w_rad_s

    def _supervise(self, now_ns: int, world: TrueRobot) -> None:
        drives = self._drives(now_ns, world)
        stands = self._frames > FRAME_HZ  # the supervisor wants it at rest for a while before it arms
        requests: tuple[DockRequest, ...] = ()
        if stands and not self._asked:
            requests = (DockRequest("dock", now_ns + NS_PER_S, "start", self._trolley),)
            self._asked = True
        lock: LockState = "open" if self._trolley == 1 else "locked"
        leader = LeaderState(True, "", (1.0,) * 4, False, "down", lock, 0.0, self._trolley - 1)
        seen = SupervisorInputs(
            now_ns=now_ns,
            state=self.state,
            drives=drives,
            arms=_ARMS,
            leader=leader,
            controller_alive=True,
            requests=requests,
        )
        self.mission = self.sequence.step(seen).mission

    def _drives(self, now_ns: int, world: TrueRobot) -> Drives:
        mission, half = self.mission, self._config.base.track_m / 2
        armed = mission is not None and mission.armed
        v, w = world.wheels
        radius = self._config.base.wheel_radius_m
        return Drives(
            state="armed" if armed else "disarmed",
            cause="",
            epoch=mission.epoch if mission is not None else 0,
            measured_ns=now_ns,
            wheel_speed_rad_s=((v - w * half) / radius, (v + w * half) / radius),
            wheel_angle_rad=world.wheel_angle_rad,
            joint_torque_n_m=(0.0,) * 6,
            joint_angle_rad=(0.0,) * 6,
            grip_torque_n_m=(0.0, 0.0),
            grip_angle_rad=(0.0, 0.0),
            lift_m=0.2,
            stop_inputs_clear=True,
            battery_v=25.0,
            v_set_m_s=0.0,
            w_set_rad_s=0.0,
            command_sequence=0,
            image_to_can_ns=0,
            gate_interventions=0,
        )


_NO_PIXELS: Image = np.zeros((1, 1), np.uint8)


def dock(
    config: Config, taught: TaughtGeometry | None, trolley: int, world: TrueRobot, watch: Watch | None = None
) -> ApproachEnd:
    """Dock once.

    Args:
        config: as the robots have it.
        taught: what taught images make of it; None: nothing was taught.
        trolley: K.
        world: at its start.
        watch: called after every frame with the time [ns], the robot's state and the world.
    """
    robot = Robot(config, taught, trolley)
    phase, frame = "idle", 0
    residuals: list[float] = []
    for frame in range(1, round(LONGEST_S * FRAME_HZ)):
        now_ns = NS_PER_S + round(frame * NS_PER_S / FRAME_HZ)
        command = robot.step(now_ns, world, now_ns)
        if command is not None:
            world.command(command)
        if watch is not None and robot.state is not None:
            watch(now_ns, robot.state, world)
        before, phase = phase, robot.sequence.phase
        if phase == "approach" and robot.state is not None:
            residuals.append(robot.state.residual_px)
        if before in _BEGUN and phase not in _BEGUN:
            break
        world.advance(1.0 / FRAME_HZ)
    error = docked_error(world.follower_in_leader, config.docking.goal(trolley))
    cause = "" if phase == "insert" else (robot.mission.cause if robot.mission else "") or f"time_limit in {phase}"
    return ApproachEnd(cause, error, frame / FRAME_HZ, float(np.median(residuals)) if residuals else 0.0)
