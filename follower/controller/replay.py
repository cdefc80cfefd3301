"""The last good plan, driven on where a new one fails."""

from __future__ import annotations

from follower.controller.interface import Plan, Velocity

MAX_REPLAYED_PLANS = 2  # periods; after that the robot holds


class PlanReplay:
    """How far into the last good plan a failed solve may still drive."""

    def __init__(self) -> None:
        self._plan: Plan | None = None
        self._replayed = 0

    def clear(self) -> None:
        """Forget the plan."""
        self._plan = None

    def keep(self, plan: Plan) -> None:
        """A good plan, whose first input is driven now."""
        self._plan, self._replayed = plan, 0

    def next_input(self) -> Velocity | None:
        """The plan's next input (v [m/s], ω [rad/s]); None without one, or after two periods."""
        self._replayed += 1
        if self._plan is None or self._replayed > MAX_REPLAYED_PLANS:
            self._plan = None
            return None
        return float(self._plan.v_m_s[self._replayed]), float(self._plan.w_rad_s[self._replayed])
