"""Every channel: one table from which subscriptions, ages, access rules, documentation and tests derive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from common.messages import (
    ArmSetpoint,
    ArmState,
    Command,
    DockingState,
    DockRequest,
    Drives,
    FollowerSummary,
    Frame,
    GatewayState,
    Health,
    LeaderState,
    LedRequest,
    LockRequest,
    ManualRequest,
    Message,
    Mission,
    NodeSnapshot,
    StepJournal,
)
from common.timing import NS_PER_MS

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class Channel(Generic[M]):
    """One key.

    ``publisher`` is the only process that publishes, or answers a request; in the phase ``manual`` the operator's
    station publishes commands instead of the controller. ``reach``: whether the key leaves the robot. ``rate_hz`` is
    0 where there is no fixed rate.
    """

    key: str
    message: type[M]
    publisher: str
    rate_hz: float
    max_age_ms: float
    reach: Literal["robot", "pair"] = "robot"
    kind: Literal["state", "request"] = "state"

    @property
    def max_age_ns(self) -> int:
        """Age beyond which a message is stale."""
        return round(self.max_age_ms * NS_PER_MS)


FRAME = Channel("follower/camera/frame", Frame, "follower-camera", 60, 100)
DOCKING_STATE = Channel("follower/state/docking", DockingState, "follower-estimator", 60, 100)
MISSION = Channel("follower/motion/mission", Mission, "follower-supervisor", 20, 200)
COMMAND = Channel("follower/motion/command", Command, "follower-controller", 20, 120)
ARM_SETPOINT = Channel("follower/motion/arm_setpoint", ArmSetpoint, "follower-arms", 100, 100)
ARM_STATE = Channel("follower/state/arms", ArmState, "follower-arms", 100, 100)
DRIVES = Channel("follower/state/drives", Drives, "follower-can-bridge", 100, 50)
FOLLOWER_SUMMARY = Channel("follower/state/summary", FollowerSummary, "follower-supervisor", 10, 500, reach="pair")
LEADER_STATE = Channel("leader/state", LeaderState, "leader", 10, 500, reach="pair")
FOLLOWER_GATEWAY = Channel("follower/gateway/state", GatewayState, "follower-gateway", 2, 2000)
LEADER_GATEWAY = Channel("leader/gateway/state", GatewayState, "leader-gateway", 2, 2000)
DOCK_REQUEST = Channel("follower/request/dock", DockRequest, "follower-supervisor", 0, 0, kind="request")
MANUAL_REQUEST = Channel("follower/request/manual", ManualRequest, "follower-supervisor", 0, 0, kind="request")
LOCK_REQUEST = Channel("leader/request/lock", LockRequest, "leader", 0, 0, reach="pair", kind="request")
LED_REQUEST = Channel("leader/request/led", LedRequest, "leader", 0, 0, reach="pair", kind="request")

CHANNELS: tuple[Channel[Any], ...] = (
    FRAME,
    DOCKING_STATE,
    MISSION,
    COMMAND,
    ARM_SETPOINT,
    ARM_STATE,
    DRIVES,
    FOLLOWER_SUMMARY,
    LEADER_STATE,
    FOLLOWER_GATEWAY,
    LEADER_GATEWAY,
    DOCK_REQUEST,
    MANUAL_REQUEST,
    LOCK_REQUEST,
    LED_REQUEST,
)

LIVE_KEYS = "live/*"


def live_key(process: str) -> str:
    """The key of the liveliness token of a process."""
    return LIVE_KEYS.replace("*", process)


def health_channel(process: str) -> Channel[Health]:
    """The channel on which a process publishes its health."""
    return Channel(f"health/{process}", Health, process, 2, 2000, reach="pair")


def journal_channel(process: str) -> Channel[StepJournal]:
    """The channel on which a process publishes what its steps consumed."""
    return Channel(f"journal/{process}", StepJournal, process, 2, 2000)


def snapshot_channel(process: str) -> Channel[NodeSnapshot]:
    """The channel on which a process publishes its state now and then, for a replay."""
    return Channel(f"snapshot/{process}", NodeSnapshot, process, 0, 2000)


_BY_KEY = {channel.key: channel for channel in CHANNELS}


def channel_of(key: str) -> Channel[Any] | None:
    """The channel of a key, those of single processes included; None for a key outside the tables."""
    kind, _, name = key.partition("/")
    if kind == "health":
        return health_channel(name)
    if kind == "journal":
        return journal_channel(name)
    return snapshot_channel(name) if kind == "snapshot" else _BY_KEY.get(key)
