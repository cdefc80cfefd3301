"""Methods behind one interface: what a method sees of each frame, and what it commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from common.geometry import Array, Pose2, extended_interaction_matrix, move_relative
from common.timing import NS_PER_MS
from experiments.feature_level.baselines.graceful import FilteredPose, graceful
from experiments.feature_level.baselines.ibvs import ibvs
from experiments.feature_level.baselines.ke import KeController, goal_in_follower
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.scenes import FRAME_RATE_HZ, NOISE_THETA_RAD
from experiments.feature_level.start_fit import fit_start
from experiments.feature_level.task import Task
from follower.controller import realtime
from follower.controller.interface import (
    FeatureController,
    FeatureState,
    MotionState,
    Plan,
    PlanStatus,
    PoseController,
)
from follower.controller.limits import limited
from follower.controller.replay import PlanReplay
from follower.estimator.observer import RelativeObserver
from follower.paper import nmpc
from follower.paper.compensation import compensation
from follower.paper.eso import ExtendedStateObserver
from follower.paper.model import extended_state, flipped_features

Twist = tuple[float, float]
FRAME_S = 1.0 / FRAME_RATE_HZ


@dataclass
class Insight:
    """What a method estimates, for the figures."""

    disturbance: Array = field(default_factory=lambda: np.zeros(4))
    compensation: Twist = (0.0, 0.0)
    solves: int = 0
    failures: int = 0


class Pilot(Protocol):
    """A method in one run."""

    insight: Insight

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        """One frame; ``wheels`` is the twist measured since the last, ``applied`` what was commanded."""

    def command(self, wheels: Twist, applied: Twist) -> Twist:
        """The next command, from all that was seen."""


class DavpcPilot:
    """The default method: disturbance-aware observer and real-time predictive control on the filtered pose."""

    def __init__(self, task: Task, controller: PoseController) -> None:
        self.insight = Insight()
        self._task, self._controller = task, controller
        self._observer = RelativeObserver(task.points_l, task.camera, task.config.estimator)
        self._started = False
        self._now_ns = 0
        self._replay = PlanReplay()
        controller.reset()

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Predict with the wheels and correct with the frame."""
        task, self._now_ns = self._task, measurement.time_ns
        if not self._started:
            sigma, theta = task.sigma, NOISE_THETA_RAD
            pose, covariance = fit_start(
                measurement.features, measurement.theta_rad, task.points_l, task.camera, sigma, theta
            )
            self._observer.reset(pose, 1.5 * covariance, measurement.time_ns)
            self._started = True
            return
        self._observer.predict(measurement.time_ns, *wheels)
        self._observer.update(measurement.features, task.sigma, (measurement.theta_rad, NOISE_THETA_RAD))

    def command(self, wheels: Twist, applied: Twist) -> Twist:
        """Plan from the pose at which the command takes effect."""
        task, disturbance = self._task, self._observer.disturbance
        effect_ns = self._now_ns + round(task.config.base.latency_ms * NS_PER_MS)
        pose = self._observer.pose_at(effect_ns, *wheels)
        state = MotionState(pose, disturbance, wheels)
        plan = self._controller.solve(state, task.servo_goal, applied, task.caps)
        self.insight.disturbance = np.array(
            [disturbance.gain, disturbance.turn_gain, disturbance.yaw_rad_s, disturbance.sideways_m_s]
        )
        self.insight.solves += 1
        self.insight.failures += not plan.usable
        return _driven(self._replay, plan)


class PaperPilot:
    """The paper's method on raw measurements; without ``compensate`` the paper's "VPC only"."""

    def __init__(self, task: Task, controller: FeatureController, compensate: bool) -> None:
        self.insight = Insight(np.zeros(2 * len(task.points_l) + 1))
        self._task, self._controller, self._compensate = task, controller, compensate
        self._observer = ExtendedStateObserver(task.heights, task.camera, task.config.controller.compensation)
        self._state: Array | None = None
        self._replay = PlanReplay()
        controller.reset()

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:
        """Measured state; a point out of view is carried on by eq. (17), the interaction matrix."""
        measured = extended_state(measurement.features, measurement.theta_rad)
        if self._state is None:
            self._state = measured
            self._observer.reset(measured)
            return
        known = self._task.config.controller.compensation.observer_input
        self._observer.update(measured, *(applied if known == "command" else wheels), FRAME_S)
        carried = self._state + FRAME_S * self._jacobian(self._state) @ np.array(wheels)
        self._state = np.where(np.isfinite(measured), measured, carried)

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """Solve, compensate, saturate: Algorithm 1."""
        task, state = self._task, self._state
        assert state is not None
        features = state[:-1].reshape(-1, 2)
        plan = self._controller.solve(FeatureState(features, float(state[-1])), task.servo_goal, applied, task.caps)
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


class IbvsPilot:
    """Basic IBVS on the newest frame."""

    def __init__(self, task: Task) -> None:
        self.insight = Insight()
        self._task, self._features = task, task.desired

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Keep the frame."""
        self._features = measurement.features

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """The law, saturated and rate-limited like all."""
        task = self._task
        return limited(
            ibvs(self._features, task.desired, task.heights, task.camera), applied, task.caps, task.config.limits
        )


class KePilot:
    """Ke et al., with the point whose depth is observed best."""

    def __init__(self, task: Task) -> None:
        self.insight = Insight()
        limits = task.config.limits
        self._task = task
        self._point = int(np.argmax(np.abs(task.heights)))
        self._goal_to_point = task.goal_leader_in_follower.as_array()[:2] + task.points_l[self._point, :2]
        self._controller = KeController((limits.v_min_m_s, limits.v_max_m_s), limits.w_max_rad_s)
        self._state: Array | None = None

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """State from one point and θ; carried on by the wheels while the point is out of view."""
        feature, height = measurement.features[self._point], float(self._task.heights[self._point])
        if np.isfinite(feature[0]) and feature[1] * height > 0:
            theta = measurement.theta_rad
            self._state = goal_in_follower(feature, theta, height, self._goal_to_point, self._task.camera)
        elif self._state is not None:
            moved = move_relative(Pose2(self._state[1], self._state[2], self._state[0]), *wheels, FRAME_S)
            self._state = np.array([moved.theta_rad, moved.x_m, moved.y_m])

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """Velocity bounds only: the method has no rate limit."""
        return self._controller.solve(self._state) if self._state is not None else (0.0, 0.0)


class PoseBasedPilot:
    """A pose of each frame, filtered in odometry, and the graceful controller."""

    def __init__(self, task: Task) -> None:
        self.insight = Insight()
        self._task = task
        self._filtered: FilteredPose | None = None
        self._arrived = False

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Odometry always, the detection when all features are seen."""
        task = self._task
        if self._filtered is not None:
            self._filtered.predict(move_relative(Pose2(0.0, 0.0, 0.0), *wheels, FRAME_S).inverse())
        if not np.isfinite(measurement.features).all():
            return
        pose, _ = fit_start(
            measurement.features, measurement.theta_rad, task.points_l, task.camera, task.sigma, NOISE_THETA_RAD
        )
        if self._filtered is None:
            self._filtered = FilteredPose(pose)
        self._filtered.correct(pose)

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """Towards the goal until it is reached once; then stand."""
        task = self._task
        if self._filtered is None or self._arrived:
            return limited((0.0, 0.0), applied, task.caps, task.config.limits)
        goal = self._filtered.pose.compose(task.goal_leader_in_follower.inverse())
        wanted = graceful(goal, task.config.limits.w_max_rad_s)
        self._arrived = wanted == (0.0, 0.0)
        return limited(wanted, applied, task.caps, task.config.limits)


METHODS = ("ibvs", "ke", "pose_based", "vpc", "paper", "davpc")


class PilotFactory:
    """Makes a method's pilots; its solver is built once, since that takes longer than a run's first second."""

    def __init__(self, method: str, task: Task) -> None:
        if method not in METHODS:
            raise ValueError(f"method {method!r} is none of {', '.join(METHODS)}")
        self._method, self.task = method, task
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
            return IbvsPilot(self.task)
        return KePilot(self.task) if self._method == "ke" else PoseBasedPilot(self.task)
