"""The manual mode: the operator moves wheels, fingers or lift, hold-to-run: a pure state machine.

It arms its own epoch, with the low caps of the phase ``manual``, only while no docking is in progress, and as long as
commands of that epoch arrive from the station that asked. They pass the gate like those of the controller, which is
silent meanwhile: when the station dies, is stopped or loses its terminal, the gate finds the last command too old and
stops, and this mode ends.
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
    """Inputs of one step; None is what is missing or too old. ``phase`` is that of the docking."""

    now_ns: int
    phase: Phase
    drives: Drives | None
    arms: ArmState | None
    command: Command | None
    requests: tuple[ManualRequest, ...] = ()


class ManualMode:
    """Steps at 20 Hz, before the docking: :meth:`answer`, :meth:`answer_docking`, :meth:`watch`, :meth:`mission`."""

    def __init__(self, config: Config, run_id: int) -> None:
        self._config = config
        self._epoch = _EPOCHS_BY_HAND + run_id
        self._wanted: ManualRequest | None = None
        self._cause = ""
        self._command_ns = 0
        self._drives_ns = 0

    @property
    def active(self) -> bool:
        """Whether manual mode is on."""
        return self._wanted is not None

    def answer(self, inputs: ManualInputs) -> tuple[Answer, ...]:
        """Answer the requests for this mode; one may begin or end it."""
        return tuple(self._answer(request, inputs) for request in inputs.requests)

    def answer_docking(self, request: DockRequest) -> Answer:
        """Answer a request for the docking while this mode is on: an abort ends it."""
        if request.action == "abort":
            self._end("operator_abort")
            return Answer(request.id, "done", "manual mode ended")
        return Answer(request.id, "refused", "manual mode is on")

    def watch(self, inputs: ManualInputs) -> None:
        """End the mode when it has to."""
        if self.active:
            self._watch(inputs)

    def mission(self, docking: Mission) -> Mission:
        """The mission of the docking, or of the manual mode while it is on; afterwards its cause, while idle."""
        wanted = self._wanted
        if wanted is None:
            named = docking.phase in _FREE_PHASES and not docking.cause and self._cause
            return replace(docking, cause=f"manual: {self._cause}"[:400]) if named else docking
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
            return Answer(request.id, "expired", "expired before it was handled")
        if request.action == "stop":
            self._end("")
            return Answer(request.id, "done", "disarmed")
        refusal = self._refusal(inputs) or self._beyond_travel(request)
        if refusal:
            return Answer(request.id, "refused", refusal)
        self._wanted = request
        self._epoch += 1
        self._command_ns = inputs.now_ns + _FIRST_COMMAND_NS
        return Answer(request.id, "accepted", "armed as long as its commands arrive")

    def _refusal(self, inputs: ManualInputs) -> str:
        """Why the mode may not begin; empty if it may."""
        if self.active:
            return "manual mode is in use by another station"
        if inputs.phase == "aborted":
            return "the last docking was aborted: reset first (davpc dock reset)"
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
        return f"the lift reaches at most {1000 * most_m:.0f} mm (follower_can.lift_max_m)"

    def _watch(self, inputs: ManualInputs) -> None:
        drives = inputs.drives
        if drives is not None:
            self._drives_ns = inputs.now_ns
        ours = drives is not None and drives.epoch == self._epoch
        if inputs.command is not None and inputs.command.epoch == self._epoch:
            self._command_ns = inputs.now_ns
        if inputs.now_ns - self._drives_ns > 2 * _SILENT_NS:
            self._end("drives_silent")
        elif drives is not None and not drives.stop_inputs_clear:
            self._end("stop_input")
        elif drives is not None and ours and drives.state in ("stopped", "fault"):
            self._end(f"gate_stop: {drives.cause}")
        elif drives is not None and ours and drives.state == "armed" and inputs.arms and inputs.arms.cause != "ok":
            self._end(inputs.arms.cause)
        elif inputs.now_ns - self._command_ns > _SILENT_NS:
            self._end("station_silent")

    def _end(self, cause: str) -> None:
        self._wanted = None
        self._cause = cause
