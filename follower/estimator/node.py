"""Estimator process: frame → docking state."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from common.channels import DOCKING_STATE, DRIVES, FRAME, MISSION
from common.frame_ring import FrameReader
from common.kinematics import twist_from_wheels
from common.node import Inbox, Node, NodeContext, Output, Trigger
from common.timing import NS_PER_S
from follower.estimator.state import StateEstimator

_NO_DOCKING = ("idle", "done", "aborted")


class EstimatorNode(Node):
    """Steps with each frame; without one it says so at 20 Hz."""

    name = "follower-estimator"
    inputs = (FRAME, DRIVES, MISSION)
    outputs = (DOCKING_STATE,)
    trigger = Trigger(period_ns=NS_PER_S // 20, wakes=(FRAME,))

    def __init__(self, context: NodeContext) -> None:
        self._base = context.config.base
        self._reader = FrameReader(context.runtime)
        self._estimator = StateEstimator(context.config)
        cv2.setNumThreads(1)

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """The state of the newest frame; after 100 ms without one, an invalid state."""
        frame = inputs.arrived(FRAME)
        if frame is None:
            if inputs.fresh(FRAME, now_ns) is not None:
                return ()
            return ((DOCKING_STATE, self._estimator.no_frame(now_ns)),)
        drives = inputs.fresh(DRIVES, now_ns)
        twist = twist_from_wheels(self._base, drives.wheel_speed_rad_s) if drives else (0.0, 0.0)
        mission = inputs.newest(MISSION)
        if mission is None or mission.message.phase in _NO_DOCKING:
            self._estimator.let_go()
        desired = np.array(mission.message.desired_features) if mission else None
        return ((DOCKING_STATE, self._estimator.step(frame, self._reader.read(frame), twist, desired)),)


def make(context: NodeContext) -> EstimatorNode:
    """The estimator process."""
    return EstimatorNode(context)
