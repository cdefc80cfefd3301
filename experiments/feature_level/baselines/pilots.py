"""Basic IBVS and the method of Ke et al. in a run."""

from __future__ import annotations

import numpy as np

from common.geometry import Array, Pose2, move_relative
from experiments.feature_level.baselines.ibvs import ibvs
from experiments.feature_level.baselines.ke import KeController, KeWeights, goal_in_follower
from experiments.feature_level.feature_world import FrameMeasurement
from experiments.feature_level.task import FRAME_S, Insight, Task, Twist
from follower.controller.limits import limited


class IbvsPilot:
    """Basic IBVS on the newest frame."""

    def __init__(self, task: Task, gain_1_s: float) -> None:
        self.insight = Insight()
        self._task, self._gain_1_s, self._features = task, gain_1_s, task.desired

    def see(self, measurement: FrameMeasurement, wheels: Twist, applied: Twist) -> None:  # noqa: ARG002
        """Keep the frame."""
        self._features = measurement.features

    def command(self, wheels: Twist, applied: Twist) -> Twist:  # noqa: ARG002
        """The law, saturated and rate-limited like all."""
        task = self._task
        wanted = ibvs(self._features, task.desired, task.heights, task.camera, self._gain_1_s)
        return limited(wanted, applied, task.caps, task.config.limits)


class KePilot:
    """Ke et al., with the point whose depth is observed best."""

    def __init__(self, task: Task, weights: KeWeights) -> None:
        self.insight = Insight()
        limits = task.config.limits
        self._task = task
        self._point = int(np.argmax(np.abs(task.heights)))
        self._goal_to_point = task.goal_leader_in_follower.as_array()[:2] + task.points_l[self._point, :2]
        self._controller = KeController(limits, weights)
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
        """Within the limits of all methods, which its problem has too."""
        wanted = self._controller.solve(self._state, applied) if self._state is not None else (0.0, 0.0)
        return limited(wanted, applied, self._task.caps, self._task.config.limits)
