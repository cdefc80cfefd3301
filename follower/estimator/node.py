"""Estimator process: frame → docking state."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from common.channels import DOCKING_STATE, DRIVES, FRAME, MISSION
from common.frames.ring import FrameReader
from common.kinematics import twist_from_wheels
from common.messages import Drives
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.estimator.state import StateEstimator
from follower.model.odometry import FASTEST_RAD_S, PoseIncrement, WheelOdometry
from follower.model.taught import taught_robots

_NO_DOCKING = ("idle", "done", "aborted")


class EstimatorNode(Node):
    """Steps with each frame; without one it publishes that at 20 Hz."""

    name = "follower-estimator"
    inputs = (FRAME, DRIVES, MISSION)
    outputs = (DOCKING_STATE,)
    trigger = Trigger(period_ns=NS_PER_S // 20, wakes=(FRAME,))

    def __init__(self, context: NodeContext) -> None:
        self._base = context.config.base
        self._leds = len(context.config.leds.points)
        self._reader = context.device("frames", FrameReader(context.runtime))
        self._odometry = WheelOdometry(self._base)
        self._measured = (0.0, 0.0)
        self._estimator = StateEstimator(taught_robots(context.config, context.config_path))
        cv2.setNumThreads(1)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """The state of the newest frame; after 100 ms without one, or if it is older than that or stamped in the
        future, an invalid state. Without a mission, or with one for other LEDs, there is no homography.
        """
        frame = inputs.arrived(FRAME)
        if frame is None and inputs.fresh(FRAME, now_ns) is not None:
            return ()
        mission = inputs.newest(MISSION)
        if mission is None or mission.message.phase in _NO_DOCKING:
            self._estimator.forget_track()
        twist = self._twist(inputs.fresh(DRIVES, now_ns))
        if frame is None:
            return ((DOCKING_STATE, self._estimator.no_frame(now_ns, twist)),)
        if not 0 <= now_ns - frame.capture_ns <= FRAME.max_age_ns:
            return ((DOCKING_STATE, self._estimator.no_frame(now_ns, twist, "stale_frame")),)
        desired = np.array(mission.message.desired_features) if mission else None
        if desired is not None and desired.shape != (self._leds, 2):
            desired = None
        return ((DOCKING_STATE, self._estimator.step(frame, self._reader.read(frame), twist, desired)),)

    def _twist(self, drives: Drives | None) -> tuple[float, float]:
        """Mean since the measurement before, by the wheels' angles; none without drives, for then they stand.

        Where angles cannot be compared the speeds count, unless no wheel can have them.
        """
        if drives is None:
            return 0.0, 0.0
        moved = self._odometry.advance(drives.measured_ns, drives.wheel_angle_rad)
        if isinstance(moved, PoseIncrement):
            self._measured = moved.twist
        elif moved != "repeated":
            plausible = max(map(abs, drives.wheel_speed_rad_s)) <= FASTEST_RAD_S
            self._measured = twist_from_wheels(self._base, drives.wheel_speed_rad_s) if plausible else (0.0, 0.0)
        return self._measured


def make(context: NodeContext) -> EstimatorNode:
    """The estimator process."""
    return EstimatorNode(context)
