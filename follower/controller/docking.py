"""Docking state and mission in, velocity command out: the step of Algorithm 1 that chooses u_F."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.geometry import Array, Pose2, features_at
from common.messages import DockingState, Mission
from common.timing import NS_PER_MS, NS_PER_S
from follower.controller.interface import Plan, PredictiveController, SpeedCaps
from follower.model.motion import MotionDisturbance, advance
from follower.paper.compensation import limited
from follower.paper.method import PaperMethod

MAX_REPLAYED_PLANS = 2


@dataclass(frozen=True)
class Twist:
    """A velocity of {F} and how it came about."""

    v_m_s: float
    w_rad_s: float
    source: str


ZERO = Twist(0.0, 0.0, "hold")


class DockingController:
    """Steps at the control period; what is published must be given back to :meth:`commit`.

    Every twist keeps the caps and the rate limit against the last one that was committed, but for zero, which
    holds at once: the drives ramp. A plan that failed is bridged by the last good one for two periods; after that
    the robot holds.
    """

    def __init__(self, config: Config, solver: PredictiveController) -> None:
        self._config = config
        self._solver = solver
        self._paper = PaperMethod(config, solver) if config.controller.method == "paper" else None
        self._plan: Plan | None = None
        self._replayed = 0
        self._last = (0.0, 0.0)

    def step(
        self, now_ns: int, state: DockingState | None, mission: Mission | None, wheels: tuple[float, float] | None
    ) -> Twist:
        """The twist to command now.

        Without a state nothing moves for long, and forwards not without a valid one; turning in place looks for one.

        Args:
            now_ns: the time.
            state: the newest, None in a gap of states.
            mission: fresh, or None.
            wheels: the twist measured at the wheels, None if it is not known.
        """
        if mission is None or not mission.armed or mission.motion == "hold":
            self._plan = None
            self._solver.reset()
            if self._paper is not None:
                self._paper.reset()
            return ZERO
        if state is None:
            return self._replay("no state", mission)
        if mission.motion == "straight" and (state.valid or mission.straight_speed_m_s < 0):
            self._plan = None
            wanted = (mission.straight_speed_m_s, 0.0)
            return Twist(*limited(wanted, self._last, self._caps(mission), self._config.limits), "straight")
        if mission.motion == "turn":
            self._plan = None
            wanted = (0.0, mission.turn_rate_rad_s)
            return Twist(*limited(wanted, self._last, self._caps(mission), self._config.limits), "turn")
        if mission.motion == "straight" or not state.valid:
            return self._replay("no valid state", mission)
        return self._servo(now_ns, state, mission, wheels)

    def commit(self, twist: Twist) -> None:
        """This twist was published: the next one starts from it."""
        self._last = (twist.v_m_s, twist.w_rad_s)

    def observe(self, state: DockingState, wheels: tuple[float, float] | None) -> None:
        """Show every docking state, also those on which no command is due: the paper's observer lives on them."""
        if self._paper is not None and state.valid:
            self._paper.observe(state, self._last, wheels)

    def _servo(self, now_ns: int, state: DockingState, mission: Mission, wheels: tuple[float, float] | None) -> Twist:
        caps = self._caps(mission)
        desired, theta_rad = np.array(mission.desired_features), mission.goal_theta_rad
        if self._paper is not None:
            plan = self._paper.plan(state, desired, theta_rad, self._last, caps)
        else:
            plan = self._plan_ahead(now_ns, state, desired, theta_rad, caps, wheels)
        if not plan.usable:
            return self._replay(plan.status.value, mission)
        self._plan, self._replayed = plan, 0
        if self._paper is not None:
            return Twist(*self._paper.compensated(state, plan.first, self._last, caps), "compensated")
        return Twist(*plan.first, "solved")

    def _plan_ahead(
        self,
        now_ns: int,
        state: DockingState,
        desired: Array,
        goal_theta_rad: float,
        caps: SpeedCaps,
        wheels: tuple[float, float] | None,
    ) -> Plan:
        """The default method: from the filtered pose, with its disturbance, where the command will take effect."""
        pose, features, theta_rad = self._at_effect(now_ns, state, wheels or self._last)
        disturbance = MotionDisturbance(*state.disturbance)
        return self._solver.solve(
            pose, features, theta_rad, desired, goal_theta_rad, self._last, caps, disturbance, wheels
        )

    def _at_effect(self, now_ns: int, state: DockingState, twist: tuple[float, float]) -> tuple[Pose2, Array, float]:
        """The filtered state moved on, disturbed as estimated, from its exposure to when the next command acts."""
        effect_s = max(now_ns - state.capture_ns, self._config.base.latency_ms * NS_PER_MS) / NS_PER_S
        captured = np.array([state.x_m, state.y_m, state.theta_rad, *state.disturbance])
        moved = advance(captured, *twist, effect_s)[0]
        pose = Pose2(float(moved[0]), float(moved[1]), float(moved[2]))
        return pose, self._features(pose), pose.theta_rad

    def _caps(self, mission: Mission) -> SpeedCaps:
        limits = self._config.limits
        return SpeedCaps(
            limits.v_min_m_s, min(limits.v_max_m_s, mission.v_max_m_s), min(limits.w_max_rad_s, mission.w_max_rad_s)
        )

    def _features(self, pose: Pose2) -> Array:
        return features_at(self._config.leds.points, pose, self._config.camera.mount)

    def _replay(self, reason: str, mission: Mission) -> Twist:
        self._replayed += 1
        if self._plan is None or self._replayed > MAX_REPLAYED_PLANS:
            self._plan = None
            return Twist(0.0, 0.0, f"hold: {reason}")
        planned = float(self._plan.v_m_s[self._replayed]), float(self._plan.w_rad_s[self._replayed])
        kept = limited(planned, self._last, self._caps(mission), self._config.limits)
        return Twist(*kept, f"previous plan: {reason}")
