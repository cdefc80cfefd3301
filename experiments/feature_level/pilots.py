"""Methods behind one interface: what a method sees of each frame, and what it commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple

import numpy as np

from common.geometry import Array, Pose2, extended_interaction_matrix
from common.timing import NS_PER_MS
from experiments.feature_level.baselines.gains import tuned_gains
from experiments.feature_level.baselines.graceful import GracefulGains, graceful
from experiments.feature_level.baselines.ke import KeWeights
from experiments.feature_level.baselines.pilots import IbvsPilot, KePilot
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.scenes import NOISE_THETA_RAD
from experiments.feature_level.start_fit import fit_start
from experiments.feature_level.task import FRAME_S, Insight, Pilot, SolverEndedError, Task, Twist
from follower.controller import realtime
from follower.controller.davpc import DavpcMethod
from follower.controller.docking import DockingController
from follower.controller.interface import (
    FeatureController,
    FeatureState,
    Plan,
    PlanStatus,
    PoseController,
)
from follower.controller.limits import limited
from follower.controller.replay import PlanReplay
from follower.estimator.observer import RelativeObserver
from follower.model.motion import MotionDisturbance
from follower.paper import nmpc
from follower.paper.compensation import compensation
from follower.paper.eso import ExtendedStateObserver
from follower.paper.model import MOST_OFF_AXIS, extended_state, flipped_features


class ObservedPose:
    """The default observer on the frames of a run: the pose and the disturbance that it estimates."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._observer = RelativeObserver(task.points_l, task.camera, task.config.estimator)
        self._now_ns: int | None = None

    @property
    def started(self) -> bool:
        """Whether a frame has been seen."""
        return self._now_ns is not None

    @property
    def time_ns(self) -> int:
        """Of the newest frame."""
        assert self._now_ns is not None
        return self._now_ns

    @property
    def pose(self) -> Pose2:
        """At the newest frame."""
        return self._observer.pose

    @property
    def disturbance(self) -> MotionDisturbance:
        """As estimated."""
        return self._observer.disturbance

    def see(self, measurement: FrameMeasurement, wheels: Twist) -> None:
        """Predict with the wheels and correct with the frame."""
        task = self._task
        if self._now_ns is None:
            pose, covariance = fit_start(
                measurement.features, measurement.theta_rad, task.points_l, task.camera, task.sigma, NOISE_THETA_RAD
            )
            self._observer.reset(pose, 1.5 * covariance, measurement.time_ns)
        else:
            self._observer.predict(measurement.time_ns, *wheels)
            self._observer.update(measurement.features, task.sigma, (measurement.theta_rad, NOISE_THETA_RAD))
        self._now_ns = measurement.time_ns

    def at_effect(self, wheels: Twist) -> Pose2:
        """The pose when a command of now takes effect."""
        effect_ns = self.time_ns + round(self._task.config.base.latency_ms * NS_PER_MS)
        return self._observer.pose_at(effect_ns, *wheels)


class DavpcPilot:
    """The default method as the robot runs it: its observer, its loop and its real-time controller.

    In place of perception stands a fit of the first frame, and θ as the paper simulates it.
    """

    def __init__(self, task: Task, controller: PoseController) -> None:
        self.insight = Insight()
        self._task, self._observed = task, ObservedPose(task)
        self._loop = DockingController(task.config, DavpcMethod(task.config, controller))
        controller.reset()

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Hand the frame to the observer."""
        self._observed.see(measurement, wheels)

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002 - the loop keeps what it commanded
        """One step of the robot's control loop."""
        observed, disturbance = self._observed, astuple(self._observed.disturbance)
        state = self._task.docking_state(observed.time_ns, observed.pose, disturbance)
        twist = self._loop.step(observed.time_ns, state, self._task.mission, wheels)
        self._loop.commit(twist)
        self.insight.disturbance = np.array(disturbance)
        self.insight.solves += 1
        self.insight.failures += twist.source != DavpcMethod.source
        return twist.v_m_s, twist.w_rad_s


class PaperPilot:
    """The paper's method; without ``compensate`` the paper's "VPC only": the same state, no u_C."""

    def __init__(self, task: Task, controller: FeatureController, compensate: bool) -> None:
        self.insight = Insight(np.zeros(2 * len(task.points_l) + 1))
        self._task, self._controller, self._compensate = task, controller, compensate
        self._config = task.config.controller.compensation
        self._observer = ExtendedStateObserver(task.heights, task.camera, self._config)
        self._measured: Array | None = None
        self._replay = PlanReplay()
        controller.reset()

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        """Measured state; a point out of view is carried on by eq. (17), the interaction matrix."""
        measured = extended_state(measurement.features, measurement.theta_rad)
        if self._measured is None:
            self._measured = measured
            self._observer.reset(measured)
            return
        self._observer.update(measured, *(applied if self._config.observer_input == "command" else wheels), FRAME_S)
        carried = self._measured + FRAME_S * self._jacobian(self._measured) @ np.array(wheels)
        if not np.all(np.abs(carried) <= MOST_OFF_AXIS):
            carried = self._measured  # unseen for too long: it says nothing any more
        self._measured = np.where(np.isfinite(measured), measured, carried)

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """Solve, compensate, saturate: Algorithm 1."""
        task = self._task
        assert self._measured is not None
        state = self._measured if self._config.initial_state == "measured" else self._observer.state
        features = state[:-1].reshape(-1, 2)
        plan = self._controller.solve(FeatureState(features, float(state[-1])), task.servo_goal, applied, task.caps)
        if plan.status is PlanStatus.TIME_LIMIT:
            raise SolverEndedError
        self.insight.solves += 1
        self.insight.failures += plan.status not in (PlanStatus.SOLVED, PlanStatus.FLIPPED_FEATURE)
        nominal = _driven(self._replay, plan)
        self.insight.disturbance = self._observer.disturbance.copy()
        if self._compensate and not flipped_features(features, task.heights):
            self.insight.compensation = compensation(self._jacobian(state), self._observer.disturbance)
            nominal = (nominal[0] + self.insight.compensation[0], nominal[1] + self.insight.compensation[1])
        return limited(nominal, applied, task.caps, task.config.limits)

    def _jacobian(self, state: Array) -> Array:
        return extended_interaction_matrix(state[:-1].reshape(-1, 2), self._task.heights, self._task.camera)


def _driven(replay: PlanReplay, plan: Plan) -> Twist:
    """The input to drive now: the plan's first, else what the last good one has next, else none."""
    if plan.usable:
        replay.keep(plan)
        return plan.first
    return replay.next_input() or (0.0, 0.0)


class PoseBasedPilot:
    """Position-based: the default observer's pose, and the graceful controller."""

    def __init__(self, task: Task, gains: GracefulGains) -> None:
        self.insight = Insight()
        self._task, self._gains = task, gains
        self._observed = ObservedPose(task)
        self._arrived = False

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Hand the frame to the observer."""
        self._observed.see(measurement, wheels)

    def command(self, wheels: Twist, applied: Twist) -> Twist:
        """Towards the goal until it is reached once; then stand."""
        task = self._task
        wanted = (0.0, 0.0)
        if self._observed.started and not self._arrived:
            goal = self._observed.at_effect(wheels).compose(task.goal_leader_in_follower.inverse())
            wanted = graceful(goal, task.config.limits.w_max_rad_s, self._gains)
            self._arrived = wanted == (0.0, 0.0)
        return limited(wanted, applied, task.caps, task.config.limits)


METHODS = ("ibvs", "ke", "pose_based", "vpc", "paper", "davpc")


class PilotFactory:
    """Makes a method's pilots; its solver is built once, since that takes longer than a run's first second.

    Args:
        method: one of ``METHODS``.
        task: robots and goal.
        gains: of a baseline, by name; None: as tuned. Those of the other methods are in the configuration.
    """

    def __init__(self, method: str, task: Task, gains: Mapping[str, float] | None = None) -> None:
        if method not in METHODS:
            raise ValueError(f"method {method!r} is none of {', '.join(METHODS)}")
        self._method, self.task = method, task
        self._gains = tuned_gains(method) if gains is None else dict(gains)
        self._own = realtime.make(task.config) if method == "davpc" else None
        self._papers = nmpc.make(task.config, "fatrop") if method in ("vpc", "paper") else None
        for controller in (self._own, self._papers):
            if controller is not None:
                controller.warm_up()

    def make(self) -> Pilot:
        """A pilot for one run."""
        if self._own is not None:
            return DavpcPilot(self.task, self._own)
        if self._papers is not None:
            return PaperPilot(self.task, self._papers, compensate=self._method == "paper")
        if self._method == "ibvs":
            return IbvsPilot(self.task, self._gains["gain_1_s"])
        if self._method == "ke":
            return KePilot(self.task, KeWeights(**self._gains))
        return PoseBasedPilot(self.task, GracefulGains(**self._gains))
