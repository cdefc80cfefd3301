"""What the phases of one docking share, and the small judgements that several of them make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from common.causes import BAD_FRAMES, NODE_SILENT, cause_code
from common.config import BaseConfig, Config
from common.geometry import Array, Pose2, features_at
from common.messages import Drives
from common.timing import NS_PER_S
from follower.model.dead_reckoning import WheelReckoning
from follower.supervisor.observed import Grip, Observed
from follower.supervisor.standstill import Standstill

# what passes by itself stops the robot, and may do so so often within so long; more often it does not pass
MAX_REARMED, REARMED_WITHIN_S = 3, 20.0
MAX_SEARCHES = 3
MAX_RETRIES = 3
MAX_PAUSES = 5


class Since:
    """For how long a condition has held without a break."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def held_s(self, holds: bool, now_ns: int) -> float:
        """Seconds that it has held, 0 if it does not."""
        if not holds:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        return 0.0 if self._since_ns is None else (now_ns - self._since_ns) / NS_PER_S


@dataclass
class Attempt:
    """One docking from start to end.

    ``armed`` is the arm token; ``enabled`` becomes true once the drives have followed it under this epoch.
    ``retreating``: it goes back to the staging pose with the trolley, to try again. ``contact_begin_m`` is the
    odometer where the insertion began.
    """

    config: Config
    trolley: int
    epoch: int
    taught: Mapping[int, Array] | None
    reckoning: WheelReckoning
    standstill: Standstill
    grip: Grip = "closed"
    armed: bool = False
    enabled: bool = False
    retreating: bool = False
    rearmed_ns: list[int] = field(default_factory=list)
    searches: int = 0
    retries: int = 0
    pauses: int = 0
    contact_begin_m: float | None = None
    goal: Pose2 = field(init=False)
    desired: Array = field(init=False)

    def __post_init__(self) -> None:
        """Desired features: as taught, or as geometry gives them."""
        config = self.config
        self.goal = config.docking.goal(self.trolley)
        if self.taught is not None:
            self.desired = self.taught[self.trolley]
        else:
            self.desired = features_at(config.leds.points, self.goal, config.camera.mount)

    @property
    def rearmed(self) -> int:
        """How often it was armed anew after somebody was late."""
        return len(self.rearmed_ns)

    def may_rearm(self, now_ns: int) -> bool:
        """Whether it has not been armed anew too often of late."""
        return sum(now_ns - at_ns < REARMED_WITHIN_S * NS_PER_S for at_ns in self.rearmed_ns) < MAX_REARMED

    def odometer_m(self, drives: Drives) -> float:
        """Way of the middle of the axle, by the wheels."""
        return sum(drives.wheel_angle_rad) / 2 * self.config.base.wheel_radius_m

    def heading_rad(self, drives: Drives) -> float:
        """Heading of {F} by the wheels, from an arbitrary zero."""
        left, right = drives.wheel_angle_rad
        return (right - left) * self.config.base.wheel_radius_m / self.config.base.track_m

    def obeyed(self, drives: Drives | None) -> bool:
        """Whether the drives are enabled under this epoch."""
        return self.armed and drives is not None and drives.state == "armed" and drives.epoch == self.epoch

    def to_goal_m(self) -> float | None:
        """How far {F} still has to go along its axis, by the last sight and odometry; None if not known."""
        pose = self.reckoning.leader_in_follower
        return None if pose is None else pose.x_m - self.goal.x_m

    def unwell(self, seen: Observed) -> str:
        """What of the Follower itself is not as it should be for moving; empty if all is well."""
        if seen.drives is None:
            return "no drives"
        if cause_code(seen.drives.cause) in (NODE_SILENT, BAD_FRAMES):
            return seen.drives.cause
        if not seen.drives.stop_inputs_clear:
            return "stop input"
        if low := undervoltage(self.config.base, seen.drives):
            return low
        if not seen.controller_alive:
            return "controller silent"
        if seen.arms is None:
            return "arms silent"
        return ""

    def rolling(self) -> str:
        """That the wheels still turn after a stop: nothing is armed on the way; empty if they do not."""
        return "" if self.standstill.holds else "standstill"

    def blind(self, seen: Observed) -> str:
        """Why the Leader's array is not in sight; empty if it is."""
        if seen.state is None:
            return "no docking state"
        return "" if seen.state.valid else f"LEDs not acquired ({seen.state.cause})"

    def leader_unready(self, seen: Observed) -> str:
        """Why the Leader's lock does not suit this trolley, as far as it is heard: the approach needs no link."""
        leader = seen.leader
        if leader is None:
            return ""
        if leader.lock == "fault":
            return f"the Leader's lock has a fault: {leader.cause}"
        if self.trolley == 1 and leader.lock != "open":
            return f"the Leader's lock is {leader.lock}, not open for trolley 1"
        if self.trolley > 1 and leader.lock != "locked":
            return f"the Leader's lock is {leader.lock}, not locked before trolley {self.trolley}"
        if self.trolley > 1 and leader.queue is not None and leader.queue != self.trolley - 1:
            return f"the Leader counts {leader.queue} trolleys, not {self.trolley - 1}"
        return ""


def undervoltage(base: BaseConfig, drives: Drives | None) -> str:
    """Why the battery bears no driving; empty if it does, or if nobody knows (SAFETY.md, row 46)."""
    if drives is None or drives.battery_v >= base.battery_min_v:
        return ""
    return f"battery at {drives.battery_v:.1f} V, below {base.battery_min_v:g} V (base.battery_min_v)"


def not_enabled(drives: Drives | None) -> str:
    """That the drives did not follow the arm token, and why as far as they say."""
    return "drives not enabled" + (f" ({drives.cause})" if drives is not None and drives.cause else "")
