"""Light that is older than its stamp: the world as it was a latency ago, between two of its states."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from common.geometry import wrap_angle
from sim.world_message import WorldState


class LateLight:
    """Keeps past states of the world for as long as light is late.

    Args:
        latency_ns: age of the light in an image beyond the stamp of the image; 0: none.
    """

    def __init__(self, latency_ns: int) -> None:
        self._latency_ns = latency_ns
        self._past: deque[WorldState] = deque()

    def seen_in(self, newest: WorldState) -> WorldState:
        """The world that the image stamped with the newest state shows; before the first state, the first."""
        if self._latency_ns == 0:
            return newest
        past, shown_ns = self._past, newest.time_ns - self._latency_ns
        past.append(newest)
        while len(past) > 2 and past[1].time_ns <= shown_ns:
            past.popleft()
        if len(past) == 1 or past[0].time_ns >= shown_ns:
            return past[0]
        before, after = past[0], past[1]
        if after.time_ns <= shown_ns:
            return after
        return between(before, after, (shown_ns - before.time_ns) / (after.time_ns - before.time_ns))


def between(before: WorldState, after: WorldState, share: float) -> WorldState:
    """Motion and tilt at a share of the way from one state to the next; all else as before.

    Args:
        before, after: states in the order of time.
        share: 0 … 1.
    """

    def mixed(first: float, last: float) -> float:
        return first + share * (last - first)

    turned = wrap_angle(after.theta_rad - before.theta_rad)
    return replace(
        before,
        x_m=mixed(before.x_m, after.x_m),
        y_m=mixed(before.y_m, after.y_m),
        theta_rad=wrap_angle(before.theta_rad + share * turned),
        v_m_s=mixed(before.v_m_s, after.v_m_s),
        w_rad_s=mixed(before.w_rad_s, after.w_rad_s),
        pitch_rad=mixed(before.pitch_rad, after.pitch_rad),
        roll_rad=mixed(before.roll_rad, after.roll_rad),
    )
