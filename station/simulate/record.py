"""What one docking leaves behind: samples of what was true, seen and commanded, and the result drawn from them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from common.channels import ARM_STATE, COMMAND, DOCKING_STATE, DRIVES, FRAME, LEADER_STATE, MISSION, Channel
from common.config import Config
from common.docking_errors import paper_errors
from common.frames.ring import FrameReader, Image
from common.geometry import Array, Pose2, features_at
from common.messages import ArmState, Command, DockingState, Drives, Frame, LeaderState, Mission, Phase
from common.timing import NS_PER_MS, NS_PER_S

PICTURE_DISTANCE_M = 0.8


@dataclass(frozen=True)
class TrueSample:
    """True Follower pose in {L} and twist at a time."""

    time_ns: int
    pose: Pose2
    v_m_s: float
    w_rad_s: float


@dataclass
class DockingRecord:
    """Collects the messages of docking ``trolley``; ``take`` each as it comes, in the order of its channel.

    Channels of the simulated world bring the truth through :meth:`take_truth`; without it the errors are None.
    """

    config: Config
    runtime: Path
    trolley: int = 1
    truth: list[TrueSample] = field(default_factory=list)
    states: list[DockingState] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    phases: list[tuple[Phase, int]] = field(default_factory=list)
    image_to_can_ms: list[float] = field(default_factory=list)
    picture: tuple[Image, DockingState] | None = None
    mission: Mission | None = None
    drives: Drives | None = None
    arms: ArmState | None = None
    leader: LeaderState | None = None
    newest_stamp_ns: int = 0
    stamps_ns: dict[str, int] = field(default_factory=dict)
    _frames: deque[Frame] = field(default_factory=lambda: deque(maxlen=6))
    _reader: FrameReader | None = None
    _interventions_before: int = 0
    _approach_commands: list[Command] = field(default_factory=list)

    CHANNELS: ClassVar[tuple[Channel[Any], ...]] = (
        FRAME,
        DOCKING_STATE,
        MISSION,
        COMMAND,
        DRIVES,
        ARM_STATE,
        LEADER_STATE,
    )

    @property
    def phase(self) -> Phase:
        """The supervisor's newest phase."""
        return self.mission.phase if self.mission else "idle"

    def take(self, channel: Channel[Any], message: Any, stamp_ns: int) -> None:
        """Take one message of :attr:`CHANNELS`, published at ``stamp_ns``."""
        self.newest_stamp_ns = max(self.newest_stamp_ns, stamp_ns)
        self.stamps_ns[channel.key] = stamp_ns
        match message:
            case Frame():
                self._frames.append(message)
            case DockingState():
                self.states.append(message)
                self._photograph(message)
            case Mission() if message.trolley != self.trolley:
                pass  # of the docking before
            case Mission():
                self.mission = message
                if not self.phases or self.phases[-1][0] != message.phase:
                    self.phases.append((message.phase, stamp_ns))
            case Command():
                self.commands.append(message)
                if self.phase == "approach":
                    self._approach_commands.append(message)
            case Drives():
                self._time_command(message)
                if self.drives is None and self.trolley > 1:
                    self._interventions_before = message.gate_interventions
                self.drives = message
            case ArmState():
                self.arms = message
            case LeaderState():
                self.leader = message
            case _:
                raise TypeError(f"{channel.key} is not recorded")

    def take_truth(self, sample: TrueSample) -> None:
        """Take one sample of the world."""
        self.truth.append(sample)

    def release(self) -> None:
        """Release the run's shared memory."""
        self._reader = None
        self._frames.clear()

    def _photograph(self, state: DockingState) -> None:
        """Keep the first frame of the last metres for which both pixels and state are at hand."""
        if self.picture is not None or not state.valid or state.x_m > self.goal().x_m + PICTURE_DISTANCE_M:
            return
        for frame in self._frames:
            if frame.sequence == state.frame_sequence:
                self._reader = self._reader or FrameReader(self.runtime)
                image = self._reader.read(frame)
                if image is not None:
                    self.picture = (image, state)

    def _time_command(self, drives: Drives) -> None:
        before = self.drives.command_sequence if self.drives else 0
        if drives.command_sequence != before and drives.image_to_can_ns and self.phase == "approach":
            self.image_to_can_ms.append(drives.image_to_can_ns / NS_PER_MS)

    def goal(self) -> Pose2:
        """Desired pose of {L} in {F}."""
        return self.config.docking.goal(self.trolley)

    @property
    def bound_m(self) -> float:
        """On the lateral error of this trolley."""
        docking = self.config.docking
        return docking.lateral_bound_first_m if self.trolley == 1 else docking.lateral_bound_next_m

    # --- results

    def phase_start_ns(self, phase: Phase) -> int | None:
        """When the phase was first announced."""
        return next((stamp for name, stamp in self.phases if name == phase), None)

    def end_of_approach(self) -> TrueSample | None:
        """The truth when the insertion began, before contact; the last sample if it never did."""
        if not self.truth:
            return None
        insert_ns = self.phase_start_ns("insert")
        before = [sample for sample in self.truth if insert_ns is None or sample.time_ns <= insert_ns]
        return before[-1] if before else self.truth[0]

    def errors(self) -> dict[str, float | None]:
        """True errors at the end of the approach: the paper's E_p and E_s."""
        sample = self.end_of_approach()
        if sample is None:
            return dict.fromkeys(("e_x_cm", "e_y_cm", "e_theta_deg", "e_p_px"))
        found = paper_errors(sample.pose, self.goal(), self.config)
        return {name: value if math.isfinite(value) else None for name, value in found.items()}

    def pixels(self, relative: Pose2) -> Array:
        """True projections of the LEDs (n, 2) from a relative pose."""
        camera = self.config.camera
        return camera.pinhole.to_pixels(features_at(self.config.leds.points, relative, camera.mount))

    def smoothness(self) -> tuple[float, float]:
        """M_sm: root mean square of the change of v and of ω from command to command, in the approach."""
        twists = np.array([(command.v_m_s, command.w_rad_s) for command in self._approach_commands])
        if len(twists) < 2:
            return 0.0, 0.0
        m_v, m_w = np.sqrt((np.diff(twists, axis=0) ** 2).mean(axis=0))
        return float(m_v), float(m_w)

    def control_rate_hz(self) -> float:
        """Commands a second in the approach."""
        stamps = [command.stamp_ns for command in self._approach_commands]
        return (len(stamps) - 1) * NS_PER_S / (stamps[-1] - stamps[0]) if len(stamps) > 1 else 0.0

    def results(self, cause: str) -> dict[str, Any]:
        """The content of ``results.json``; ``cause`` is what ended the run, if not the docking itself."""
        errors = self.errors()
        bound_cm = 100 * self.bound_m
        lateral_cm = errors["e_y_cm"]
        locked = self._locked()
        within = lateral_cm is not None and lateral_cm <= bound_cm
        connected = locked and within and self.phase == "done" and not cause
        start_ns = self.phase_start_ns("acquire")
        end_ns = self.phases[-1][1] if self.phases else 0
        m_v, m_w = self.smoothness()
        first, last = (self.states[0], self.states[-1]) if self.states else (None, None)
        latency = np.array(self.image_to_can_ms) if self.image_to_can_ms else None
        reason = cause or (self.mission.cause if self.mission else "") or ("docked" if connected else "not_docked")
        return {
            "trolley": self.trolley,
            "connected": connected,
            "cause": reason,
            "metrics": {
                **errors,
                "m_v": m_v,
                "m_w": m_w,
                "duration_s": (end_ns - start_ns) / NS_PER_S if start_ns is not None else 0.0,
            },
            "frames": {
                "seen": last.frames_seen - max(0, first.frames_seen - 1) if last and first else 0,
                "dropped": last.frames_dropped - first.frames_dropped if last and first else 0,
            },
            "image_to_can_ms": {
                "p50": float(np.percentile(latency, 50)) if latency is not None else None,
                "p99": float(np.percentile(latency, 99)) if latency is not None else None,
            },
            "control_hz": self.control_rate_hz(),
            "rearmed": max(0, sum(name == "acquire" for name, _ in self.phases) - 1),
            "gate_interventions": self.drives.gate_interventions - self._interventions_before if self.drives else 0,
            "phases_s": self._phase_durations(),
        }

    def _locked(self) -> bool:
        """The Leader reports this trolley locked; after a restart its count is not known."""
        leader = self.leader
        return leader is not None and leader.lock == "locked" and leader.queue in (None, self.trolley)

    def _phase_durations(self) -> dict[str, float]:
        following = [stamp for _, stamp in self.phases[1:]]
        durations: dict[str, float] = {}
        for (name, start_ns), end_ns in zip(self.phases, following, strict=False):
            if name != "idle":
                durations[name] = durations.get(name, 0.0) + (end_ns - start_ns) / NS_PER_S
        return durations
