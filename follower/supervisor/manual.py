"""The manual mode: a person moves wheels, fingers or lift, held-to-run, as a pure state machine beside the docking.

It arms an epoch of its own, with the low caps of the phase ``manual``, only while no docking is under way, and for as
long as commands of that epoch keep coming from the station that asked. They pass the gate like the controller's,
which is silent meanwhile: when the station dies, is stopped or loses its terminal, the gate finds the last command
too old and stops, and this mode ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from common.config import Config
from common.messages import Answer, ArmState, Command, DockRequest, Drives, ManualRequest, Mission, Phase
from common.timing import NS_PER_MS, NS_PER_S
from follower.supervisor.attempt import undervoltage

# the station learns the epoch from the mission before it can command
_FIRST_COMMAND_NS = 2 * NS_PER_S
_SILENT_NS = 150 * NS_PER_MS
_FREE_PHASES: tuple[Phase, ...] = ("idle", "done")
# epochs of dockings count up from a run id of 62 bits: these never meet them
_EPOCHS_BY_HAND = 1 << 62


@dataclass(frozen=True, kw_only=True)
class ManualInputs:
    """What this mode looks at in one step; None is what is missing or too old. ``phase`` is the docking's."""

    now_ns: int
    phase: Phase
    drives: Drives | None
    arms: ArmState | None
    command: Command | None
    requests: tuple[ManualRequest, ...] = ()
    dock_requests: tuple[DockRequest, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ManualOutputs:
    """Answers, and the dock requests that are left for the docking."""

    answers: tuple[Answer, ...]
    dock_answers: tuple[Answer, ...]
    dock_requests: tuple[DockRequest, ...]


class ManualMode:
    """Steps at 20 Hz before the docking's sequence; :meth:`mission` then replaces what that wants."""

    def __init__(self, config: Config, run_id: int) -> None:
        self._config = config
        self._epoch = _EPOCHS_BY_HAND + run_id
        self._wanted: ManualRequest | None = None
        self._cause = ""
        self._heard_ns = 0
        self._drives_ns = 0

    @property
    def active(self) -> bool:
        """Whether a person moves the robot."""
        return self._wanted is not None

    def step(self, inputs: ManualInputs) -> ManualOutputs:
        """Answer requests, and end the mode when it has to."""
        answers = tuple(self._answer(request, inputs) for request in inputs.requests)
        dock_answers, left = [], []
        for request in inputs.dock_requests:
            if not self.active:
                left.append(request)
            elif request.action == "abort":
                self._end("operator_abort")
                dock_answers.append(Answer(request.id, "done", "manual mode ended"))
            else:
                dock_answers.append(Answer(request.id, "refused", "a person moves the robot: manual mode is on"))
        if self.active:
            self._watch(inputs)
        return ManualOutputs(answers=answers, dock_answers=tuple(dock_answers), dock_requests=tuple(left))

    def mission(self, docking: Mission) -> Mission:
        """The docking's mission, or that of the manual mode while it is on; afterwards why it ended, while idle."""
        wanted = self._wanted
        if wanted is None:
            told = docking.phase in _FREE_PHASES and not docking.cause and self._cause
            return replace(docking, cause=f"manual: {self._cause}"[:400]) if told else docking
        limits = self._config.supervisor
        return replace(
            docking,
            phase="manual",
            cause="",
            epoch=self._epoch,
            armed=True,
            motion="hold",
            straight_speed_m_s=0.0,
            v_max_m_s=limits.manual_speed_m_s,
            w_max_rad_s=limits.manual_turn_rad_s,
            grip=wanted.grip,
            contact_expected=False,
            lift_m=wanted.lift_m,
        )

    def _answer(self, request: ManualRequest, inputs: ManualInputs) -> Answer:
        if inputs.now_ns > request.expires_ns:
            return Answer(request.id, "expired", "came after its expiry")
        if request.action == "stop":
            self._end("")
            return Answer(request.id, "done", "disarmed")
        refusal = self._refusal(inputs) or self._beyond_travel(request)
        if refusal:
            return Answer(request.id, "refused", refusal)
        self._wanted = request
        self._epoch += 1
        self._cause = ""
        self._heard_ns = inputs.now_ns + _FIRST_COMMAND_NS
        self._drives_ns = inputs.now_ns
        return Answer(request.id, "accepted", "armed while its commands come")

    def _refusal(self, inputs: ManualInputs) -> str:
        """What keeps a person from moving the robot; empty if nothing does."""
        if self.active:
            return "another station has the manual mode"
        if inputs.phase == "aborted":
            return "the last docking was aborted: reset it first"
        if inputs.phase not in _FREE_PHASES:
            return f"a docking is under way: phase {inputs.phase}"
        if inputs.drives is None:
            return "the CAN bridge is silent"
        if inputs.arms is None:
            return "the arms' process is silent"
        if not inputs.drives.stop_inputs_clear:
            return "a stop input is active"
        if inputs.drives.state == "fault":
            return f"drives: {inputs.drives.cause}"[:400]
        return undervoltage(self._config.base, inputs.drives)

    def _beyond_travel(self, request: ManualRequest) -> str:
        most_m = self._config.follower_can.lift_max_m
        if request.lift_m is None or request.lift_m <= most_m:
            return ""
        return f"the lift goes up to {1000 * most_m:.0f} mm (follower_can.lift_max_m)"

    def _watch(self, inputs: ManualInputs) -> None:
        drives = inputs.drives
        if drives is not None:
            self._drives_ns = inputs.now_ns
        ours = drives is not None and drives.epoch == self._epoch
        if inputs.command is not None and inputs.command.epoch == self._epoch:
            self._heard_ns = inputs.now_ns
        if inputs.now_ns - self._drives_ns > 2 * _SILENT_NS:
            self._end("drives_silent")
        elif drives is not None and not drives.stop_inputs_clear:
            self._end("stop_input")
        elif drives is not None and ours and drives.state in ("stopped", "fault"):
            self._end(f"gate_stop: {drives.cause}")
        elif drives is not None and ours and drives.state == "armed" and inputs.arms and inputs.arms.cause != "ok":
            self._end(inputs.arms.cause)
        elif inputs.now_ns - self._heard_ns > _SILENT_NS:
            self._end("station_silent")

    def _end(self, cause: str) -> None:
        self._wanted = None
        self._cause = cause
