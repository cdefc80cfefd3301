"""One record per attempt: durations, margins to limits, interventions, and how it ended."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

from common.causes import cause_code
from common.channels import DOCKING_STATE
from common.config import Config
from common.docking_errors import docked_error
from common.geometry import Pose2
from common.messages import DockingState, Drives, Mission, Phase
from common.timing import NS_PER_MS, NS_PER_S
from follower.supervisor.attempt import Attempt
from follower.supervisor.interface import SupervisorInputs
from follower.supervisor.journal import ATTEMPT_SCHEMA
from follower.supervisor.transitions import ENDED

_SERVOED: tuple[Phase, ...] = ("approach",)


@dataclass
class _AttemptRecord:
    """Record of the attempt in progress."""

    begin_ns: int
    since_ns: int
    phase: Phase
    interventions: int | None = None
    phases_s: dict[str, float] = field(default_factory=dict)
    rules: Counter[str] = field(default_factory=Counter)
    pauses: Counter[str] = field(default_factory=Counter)
    intervened: int = 0
    waiting: str = ""
    set_before: tuple[float, float] | None = None
    arrival: dict[str, float] | None = None
    connected: dict[str, float] | None = None
    margins: dict[str, float] = field(default_factory=dict)


class AttemptReport:
    """Steps after the sequence with the same inputs; pure."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._running: _AttemptRecord | None = None

    def step(self, inputs: SupervisorInputs, mission: Mission, attempt: Attempt) -> dict[str, Any] | None:
        """Take one step.

        Args:
            inputs: of the sequence.
            mission: that the sequence decided.
            attempt: in progress, or the last one.

        Returns:
            The record as a JSON table if an attempt ended with this step, else None.
        """
        running, phase = self._running, mission.phase
        if running is None:
            if phase not in ENDED:
                self._running = _AttemptRecord(inputs.now_ns, inputs.now_ns, phase)
            return None
        self._count_gate(running, inputs.drives)
        if running.phase in _SERVOED:
            self._measure_margins(running, inputs)
            self._count_pause(running, mission.waiting if phase == running.phase else "")
        if phase != running.phase:
            self._change(running, inputs, phase, attempt)
        if phase not in ENDED:
            return None
        self._running = None
        return self._record(running, inputs.now_ns, mission, attempt)

    def _change(self, running: _AttemptRecord, inputs: SupervisorInputs, phase: Phase, attempt: Attempt) -> None:
        spent_s = (inputs.now_ns - running.since_ns) / NS_PER_S
        running.phases_s[running.phase] = round(running.phases_s.get(running.phase, 0.0) + spent_s, 3)
        if inputs.state is not None and inputs.state.valid:
            if phase == "insert":
                running.arrival = errors(inputs.state, attempt.goal)
            elif phase == "lock" and inputs.drives is not None and attempt.contact_begin_m is not None:
                pushed_m = attempt.odometer_m(inputs.drives) - attempt.contact_begin_m
                running.connected = errors(inputs.state, replace(attempt.goal, x_m=attempt.goal.x_m - pushed_m))
        running.phase, running.since_ns = phase, inputs.now_ns
        running.set_before = None

    def _count_gate(self, running: _AttemptRecord, drives: Drives | None) -> None:
        """Count the gate's interventions by rule; of several within one step all count for the last rule."""
        if drives is None:
            return
        if running.interventions is not None:
            more = max(0, drives.gate_interventions - running.interventions)
            for rule in drives.gate_intervened.split(",") if more else ():
                running.rules[rule or "unnamed"] += more
            running.intervened += more
        running.interventions = drives.gate_interventions

    def _count_pause(self, running: _AttemptRecord, waiting: str) -> None:
        if waiting and not running.waiting:
            running.pauses[waiting] += 1
        running.waiting = waiting

    def _measure_margins(self, running: _AttemptRecord, inputs: SupervisorInputs) -> None:
        """Smallest margins: to the image's edge, the gate's rate limits, the age at which a state is refused."""
        state, drives = inputs.state, inputs.drives
        if state is not None:
            age_ms = (inputs.now_ns - state.capture_ns) / NS_PER_MS
            self._least(running, "age_ms", DOCKING_STATE.max_age_ms - age_ms)
            for feature in state.features:
                if feature is not None:
                    self._least(running, "field_of_view_px", self._to_edge_px(*feature))
        if drives is not None:
            setpoint = drives.v_set_m_s, drives.w_set_rad_s
            before, running.set_before = running.set_before, setpoint
            if before is not None:
                period_s = self._config.controller.period_ms / 1000.0
                limits = self._config.limits
                v_most = limits.gate_acceleration_m_s2 * period_s
                w_most = limits.gate_angular_acceleration_rad_s2 * period_s
                self._least(running, "dv_m_s", v_most - abs(setpoint[0] - before[0]))
                self._least(running, "dw_rad_s", w_most - abs(setpoint[1] - before[1]))

    def _to_edge_px(self, alpha: float, beta: float) -> float:
        camera = self._config.camera
        lens = camera.lens
        u, v = lens.cx_px + lens.fx_px * alpha, lens.cy_px + lens.fy_px * beta
        return min(u, v, camera.width_px - 1 - u, camera.height_px - 1 - v)

    def _least(self, running: _AttemptRecord, name: str, value: float) -> None:
        running.margins[name] = min(value, running.margins.get(name, math.inf))

    def _record(self, running: _AttemptRecord, now_ns: int, mission: Mission, attempt: Attempt) -> dict[str, Any]:
        return {
            "schema": ATTEMPT_SCHEMA,
            "trolley": attempt.trolley,
            "epoch": attempt.epoch,
            "method": self._config.controller.method,
            "docked": mission.phase == "done",
            "cause": mission.cause,
            "code": cause_code(mission.cause),
            "needs_reset": mission.needs_reset,
            "duration_s": round((now_ns - running.begin_ns) / NS_PER_S, 3),
            "phases_s": running.phases_s,
            "arrival": running.arrival,
            "connected": running.connected,
            "margins": {name: round(value, 4) for name, value in running.margins.items()},
            "gate": {"interventions": running.intervened, "rules": dict(running.rules)},
            "retries": attempt.retries,
            "searches": attempt.searches,
            "pauses": dict(running.pauses),
            "rearmed": attempt.rearmed,
        }


def errors(state: DockingState, goal: Pose2) -> dict[str, float]:
    """The estimated error against a goal (pose of {L} in {F}), signed, in cm and degrees."""
    error = docked_error(Pose2(state.x_m, state.y_m, state.theta_rad).inverse(), goal)
    return {
        "e_x_cm": round(100 * error.e_x_m, 3),
        "e_y_cm": round(100 * error.e_y_m, 3),
        "e_theta_deg": round(error.e_theta_deg, 3),
    }
