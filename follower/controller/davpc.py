"""The default method: plan from the filtered pose, disturbed as estimated, where the command will take effect."""

from __future__ import annotations

import numpy as np

from common.config import Config
from common.geometry import Pose2
from common.messages import DockingState
from common.timing import NS_PER_MS, NS_PER_S
from follower.controller import realtime
from follower.controller.interface import MotionState, Plan, PoseController, Request, Velocity
from follower.model.motion import MotionDisturbance, advance


class DavpcMethod:
    """The estimator has filtered already; what is left is to move its state on to when the next command acts."""

    source = "solved"

    def __init__(self, config: Config, controller: PoseController) -> None:
        self._latency_ns = config.base.latency_ms * NS_PER_MS
        self._controller = controller

    def warm_up(self) -> None:
        """Solve typical problems once."""
        self._controller.warm_up()

    def reset(self) -> None:
        """Forget the last solution."""
        self._controller.reset()

    def observe(self, state: DockingState, last_applied: Velocity, wheels: Velocity | None) -> None:
        """Nothing: each docking state carries all that is known."""

    def plan(self, request: Request) -> tuple[Plan, Velocity]:
        """From the pose at which the next command takes effect; the plan's first input keeps all limits itself."""
        state = _at_effect(request, self._latency_ns)
        plan = self._controller.solve(state, request.goal, request.last_applied, request.caps)
        return plan, plan.first


def _at_effect(request: Request, latency_ns: float) -> MotionState:
    """The filtered state moved on, disturbed as estimated, from its exposure to when the next command acts."""
    state = request.state
    effect_s = max(request.now_ns - state.capture_ns, latency_ns) / NS_PER_S
    captured = np.array([state.x_m, state.y_m, state.theta_rad, *state.disturbance])
    moved = advance(captured, *(request.wheels or request.last_applied), effect_s)[0]
    pose = Pose2(float(moved[0]), float(moved[1]), float(moved[2]))
    return MotionState(pose, MotionDisturbance(*state.disturbance), request.wheels)


def make(config: Config) -> DavpcMethod:
    """The default method of a configuration."""
    return DavpcMethod(config, realtime.make(config))
