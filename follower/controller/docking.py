"""Docking state and mission in, velocity command out: the step of Algorithm 1 that chooses u_F."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.config import Config
from common.messages import DockingState, Mission
from follower.controller.interface import DockingMethod, Goal, Request, SpeedCaps, Velocity
from follower.controller.limits import limited
from follower.controller.replay import PlanReplay


@dataclass(frozen=True)
class Twist:
    """A velocity of {F} and how it came about."""

    v_m_s: float
    w_rad_s: float
    source: str


ZERO = Twist(0.0, 0.0, "hold")


class DockingController:
    """Steps at the control period; what is published must be given back to :meth:`commit`.

    Every twist keeps the caps and the rate limit against the last one that was committed, except a stop, which
    applies immediately: the drives ramp. The last good plan bridges a failed one for two periods; after that
    the robot holds.
    """

    def __init__(self, config: Config, method: DockingMethod) -> None:
        self._limits = config.limits
        self._method = method
        self._replay = PlanReplay()
        self._last: Velocity = (0.0, 0.0)

    def step(
        self, now_ns: int, state: DockingState | None, mission: Mission | None, wheels: Velocity | None
    ) -> Twist:
        """The twist to command now.

        Without a state, motion ends after two periods. Forward motion needs a valid state; turning in place does not.

        Args:
            now_ns: the time.
            state: the newest, None in a gap of states.
            mission: fresh, or None.
            wheels: the twist measured at the wheels, None if it is not known.
        """
        if mission is None or not mission.armed or mission.motion == "hold":
            self._replay.clear()
            self._method.reset()
            return ZERO
        if state is None:
            return self._bridge("no state", mission)
        if mission.motion == "straight" and (state.valid or mission.straight_speed_m_s < 0):
            self._replay.clear()
            return Twist(*self._limited((mission.straight_speed_m_s, 0.0), mission), "straight")
        if mission.motion == "turn":
            self._replay.clear()
            return Twist(*self._limited((0.0, mission.turn_rate_rad_s), mission), "turn")
        if mission.motion == "straight" or not state.valid:
            return self._bridge("no valid state", mission)
        return self._servo(now_ns, state, mission, wheels)

    def commit(self, twist: Twist) -> None:
        """This twist was published: the next one starts from it."""
        self._last = (twist.v_m_s, twist.w_rad_s)

    def observe(self, state: DockingState, wheels: Velocity | None) -> None:
        """Take every docking state, also those on which no command is due: the paper's observer needs them."""
        if state.valid:
            self._method.observe(state, self._last, wheels)

    def _servo(self, now_ns: int, state: DockingState, mission: Mission, wheels: Velocity | None) -> Twist:
        request = Request(
            now_ns=now_ns,
            state=state,
            goal=Goal(np.array(mission.desired_features), mission.goal_theta_rad),
            last_applied=self._last,
            caps=self._caps(mission),
            wheels=wheels,
        )
        plan, velocity = self._method.plan(request)
        if not plan.usable:
            return self._bridge(plan.status.value, mission)
        self._replay.keep(plan)
        return Twist(*velocity, self._method.source)

    def _bridge(self, reason: str, mission: Mission) -> Twist:
        planned = self._replay.next_input()
        if planned is None:
            return Twist(0.0, 0.0, f"hold: {reason}")
        return Twist(*self._limited(planned, mission), f"previous plan: {reason}")

    def _limited(self, wanted: Velocity, mission: Mission) -> Velocity:
        return limited(wanted, self._last, self._caps(mission), self._limits)

    def _caps(self, mission: Mission) -> SpeedCaps:
        limits = self._limits
        return SpeedCaps(
            v_min_m_s=limits.v_min_m_s,
            v_max_m_s=min(limits.v_max_m_s, mission.v_max_m_s),
            w_max_rad_s=min(limits.w_max_rad_s, mission.w_max_rad_s),
        )
