"""State that the phases of one docking share, and the checks that several of them make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from common.causes import BAD_FRAMES, BAD_MESSAGE, BUS_LOST, NODE_SILENT, cause_code
from common.config import BaseConfig, Config
from common.geometry import Array, Pose2, features_at
from common.kinematics import path_from_wheels
from common.messages import Drives
from common.timing import NS_PER_S
from follower.model.dead_reckoning import WheelReckoning
from follower.model.taught import geometry_tag
from follower.standstill import Standstill
from follower.supervisor.image_trust import NOT_FOLLOWING, ImageTrust
from follower.supervisor.interface import Grip, SupervisorInputs

# a stop for a passing cause is re-armed this often within this time; more often the cause is not a passing one
MAX_REARMED, REARMED_WITHIN_S = 3, 20.0
MAX_SEARCHES = 3
MAX_RETRIES = 3
MAX_PAUSES = 5
# passing causes: a deadline was missed, the machine stalled, or what came could not be decoded
REARMING_CAUSES: Final = frozenset(
    {
        "command_age",
        "valid_until",
        "token_age",
        "status_age",
        "arm_setpoint_age",
        "bridge_stalled",
        NODE_SILENT,
        BAD_FRAMES,
        BUS_LOST,
        BAD_MESSAGE,
    }
)
OTHER_GEOMETRY: Final = "the estimator goes by other taught images or measures: restart davpc-follower.target"


@dataclass(kw_only=True)
class Attempt:
    """One docking from start to end.

    ``armed`` is the arm token; ``enabled`` becomes true once the drives have followed it under this epoch.
    ``retreating``: back to the staging pose with the trolley, to try again. ``contact_begin_m`` is the odometer
    reading where the insertion began.
    """

    config: Config
    trolley: int
    epoch: int
    taught: Mapping[int, Pose2] | None
    reckoning: WheelReckoning
    standstill: Standstill
    grip: Grip
    armed: bool = False
    enabled: bool = False
    retreating: bool = False
    rearmed_ns: list[int] = field(default_factory=list)
    searches: int = 0
    retries: int = 0
    pauses: int = 0
    contact_begin_m: float | None = None
    trust: ImageTrust = field(init=False)
    geometry: str = field(init=False)
    goal: Pose2 = field(init=False)
    desired: Array = field(init=False)

    def __post_init__(self) -> None:
        """The goal, and the features there: taught images have corrected the geometry that gives them."""
        config, taught = self.config, self.taught or {}
        self.trust = ImageTrust(config)
        self.geometry = geometry_tag(config)
        self.goal = taught.get(self.trolley, config.docking.goal(self.trolley))
        self.desired = features_at(config.leds.points, self.goal, config.camera.mount)

    @property
    def rearmed(self) -> int:
        """How often it was re-armed after a passing stop."""
        return len(self.rearmed_ns)

    def may_rearm(self, now_ns: int) -> bool:
        """Whether it has been re-armed less often than allowed in the last seconds."""
        return sum(now_ns - at_ns < REARMED_WITHIN_S * NS_PER_S for at_ns in self.rearmed_ns) < MAX_REARMED

    def odometer_m(self, drives: Drives) -> float:
        """Distance along the path of {F} by the wheels, from an arbitrary zero."""
        return path_from_wheels(self.config.base, drives.wheel_angle_rad)[0]

    def heading_rad(self, drives: Drives) -> float:
        """Heading of {F} by the wheels, from an arbitrary zero."""
        return path_from_wheels(self.config.base, drives.wheel_angle_rad)[1]

    def obeyed(self, drives: Drives | None) -> bool:
        """Whether the drives are enabled under this epoch."""
        return self.armed and drives is not None and drives.state == "armed" and drives.epoch == self.epoch

    def to_goal_m(self) -> float | None:
        """Distance to the goal along the axis of {F}, from the last valid state and odometry; None if unknown."""
        pose = self.reckoning.leader_in_follower
        return None if pose is None else pose.x_m - self.goal.x_m

    def unwell(self, inputs: SupervisorInputs) -> str:
        """Why the Follower itself may not move; empty if it may."""
        if inputs.drives is None:
            return "no drives"
        if cause_code(inputs.drives.cause) in (NODE_SILENT, BAD_FRAMES, BUS_LOST):
            return inputs.drives.cause
        if not inputs.drives.stop_inputs_clear:
            return "stop input"
        if unfit := self.unfit(inputs):
            return unfit
        if not inputs.controller_alive:
            return "controller silent"
        if inputs.arms is None:
            return "arms silent"
        return ""

    def unfit(self, inputs: SupervisorInputs) -> str:
        """Why no wheel may turn now, LEDs or not: battery (S46), messages (S14), computer (S29); empty: they may."""
        if low := undervoltage(self.config.base, inputs.drives):
            return low
        if inputs.malformed:
            return f"malformed messages of {inputs.malformed}"
        return f"{inputs.late} runs late: the computer cannot keep up" if inputs.late else ""

    def rolling(self) -> str:
        """The wait for standstill before arming; empty once the wheels stand."""
        return "" if self.standstill.holds else "standstill"

    def untrusted(self, inputs: SupervisorInputs) -> str:
        """As a cause: the image did not follow the wheels, nor a turn after that; empty if it may, or may yet."""
        if inputs.drives is not None:
            self.trust.step(inputs.state, self.heading_rad(inputs.drives))
        return f"not_following: {NOT_FOLLOWING}" if self.trust.stands else ""

    def blind(self, inputs: SupervisorInputs) -> str:
        """Why the Leader's array is not in view; empty if it is."""
        if inputs.state is None:
            return "no docking state"
        if inputs.state.cause == "not_following" or (inputs.state.valid and self.trust.doubted):
            return NOT_FOLLOWING
        if inputs.state.geometry not in ("", self.geometry):
            return OTHER_GEOMETRY
        return "" if inputs.state.valid else f"LEDs not acquired ({inputs.state.cause})"

    def leader_unready(self, inputs: SupervisorInputs) -> str:
        """Why the Leader's lock does not suit this trolley; empty without a link: it is not needed yet."""
        leader = inputs.leader
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
    """Why the battery is too low to drive; empty if sufficient or not measured (``docs/safety.md`` S46)."""
    if drives is None or not base.battery_min_v:
        return ""
    if drives.battery_v is None:
        return "battery voltage not readable (analogue input 1 of the Follower's I/O module)"
    if drives.battery_v >= base.battery_min_v:
        return ""
    return f"battery at {drives.battery_v:.1f} V, below {base.battery_min_v:g} V (base.battery_min_v)"


def not_enabled(drives: Drives | None) -> str:
    """The drives did not follow the arm token; with the cause that they report, if any."""
    return "drives not enabled" + (f" ({drives.cause})" if drives is not None and drives.cause else "")


def stopped_by_silence(drives: Drives) -> bool:
    """Whether the gate stopped because the drives were silent: then the stop inputs count as STOP as well.

    That is no pressed button; a pressed one is reported in the next step, as the new epoch clears the gate's cause.
    """
    return drives.state == "stopped" and cause_code(drives.cause) in (
        NODE_SILENT,
        BUS_LOST,
        "status_age",
        "bridge_stalled",
    )
