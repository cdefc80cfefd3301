"""What happened in one run: what the bus carried, where the robot truly was, and what the processes reported."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple


class BusSample(NamedTuple):
    """After a SYNC, or every 10 ms: what the wheels' drives are commanded, and which drives are in operation.

    ``v_m_s`` and ``w_rad_s`` are the set-points of both wheels as a twist, 0 where a drive would not follow them.
    """

    t_ns: int
    v_m_s: float
    w_rad_s: float
    wheels_on: bool
    arms_on: bool

    @property
    def commanded(self) -> bool:
        """Whether any wheel is commanded to roll."""
        return self.v_m_s != 0.0 or self.w_rad_s != 0.0


class WorldSample(NamedTuple):
    """The world's truth, every 10 ms: pose of {F} in {L}, twist, handle, bolt."""

    t_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    v_m_s: float
    w_rad_s: float
    holding: bool
    force_n: float
    travel: float
    locked: bool
    pushing: bool


class MissionSample(NamedTuple):
    """What the supervisor published, where it changed."""

    t_ns: int
    phase: str
    armed: bool
    cause: str
    waiting: str


class DrivesSample(NamedTuple):
    """What the bridge published, where it changed."""

    t_ns: int
    state: str
    cause: str


class CommandSample(NamedTuple):
    """A command of the genuine controller."""

    t_ns: int
    v_m_s: float
    w_rad_s: float


@dataclass
class Trace:
    """One run from its fault on.

    Attributes:
        fault_ns: when the fault began.
        blind_ns: from when on the camera's images say nothing of the present; None: never.
        false_locks: docking states that call themselves valid and are more than 10° or 0.3 m off.
        disturbance: largest estimated disturbance, as a share of its bound.
        refused: why the docking that was requested last was refused; empty if it was not.
        error: an exception that left a process's step; in reality the process would be gone.
        end: "done", the cause of an aborted docking, or "" for one that was still under way.
        outcome: what a fault found out by itself, without a docking: a reaction, or empty.
    """

    fault_ns: int = 0
    blind_ns: int | None = None
    bus: list[BusSample] = field(default_factory=list)
    world: list[WorldSample] = field(default_factory=list)
    missions: list[MissionSample] = field(default_factory=list)
    drives: list[DrivesSample] = field(default_factory=list)
    commands: list[CommandSample] = field(default_factory=list)
    false_locks: int = 0
    disturbance: float = 0.0
    refused: str = ""
    error: str = ""
    outcome: str = ""
    end: str = ""

    def close(self) -> None:
        """The docking is watched no longer: what is requested from now on is another one."""
        if self.missions and self.missions[-1].phase in ("done", "aborted"):
            last = self.missions[-1]
            self.end = "done" if last.phase == "done" else last.cause
