"""Incidents during a collection, and how the robots react: ``davpc experiment incidents``.

Each incident runs with several seeds. It must end as ``docs/safety.md`` demands, with the right cause in the mission
and in the attempt's report, at standstill, and with the trolley still held where anything is in contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.causes import cause_code, needs_reset
from common.config import Config
from common.messages import Phase
from common.timing import NS_PER_S
from experiments.queues.incident_cases import CASES, Incident
from experiments.queues.run import Backstage, Docking, plan, run_plan
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results

START, SPREAD = (3.6, 0.25, 0.0), (0.15, 0.15, 4.0)
_STANDING_M_S = 0.01
_OCCLUDER_AHEAD_M, _OCCLUDER_RADIUS_M = 1.9, 0.45
_LINGER_S = 1.0
_WET_GRIP = 0.0  # share of the wheels' motion that moves the robot
_SEARCH_AFTER_S, _SEARCH_HIDDEN_S = 2.0, 5.0
# from a dead LED until it is noticed and the approach has slowed down
_SLOWED_S = 1.6


@dataclass(frozen=True)
class IncidentJob:
    """One incident in one seed."""

    config_text: str
    case: Incident
    seed: int
    trial: int


@dataclass(frozen=True)
class End:
    """How it ended, in the world and in the report of the attempt.

    Attributes:
        ended: the cause's code, or "done".
        cause: as reported, with its detail.
        still: the robot stood.
        held: the arms held the trolley.
        latched_rightly: it waits for a reset if, and only if, the cause needs one or something was in contact.
        happened: the incident took place.
        reported: the record on disk agrees.
        armed: the arm token was given.
        paused: causes of pauses, by the report.
        searches, rearmed: by the report.
        slow: with a dead LED the approach kept its reduced speed.
        phases: in order.
    """

    ended: str
    cause: str
    still: bool
    held: bool
    latched_rightly: bool
    happened: bool
    reported: bool
    armed: bool
    paused: str
    searches: int
    rearmed: int
    slow: bool
    phases: tuple[Phase, ...]


def run(
    out: Path, seed: int, workers: Workers, config: Config, trials: int = 5, cases: tuple[str, ...] = tuple(CASES)
) -> dict[str, Any]:
    """Run every incident ``trials`` times; write ``results.json`` and ``table.md``.

    Args:
        out: folder to write to.
        seed: random seed; the results do not depend on ``workers``.
        workers: who does the runs.
        config: the robots.
        trials: runs of each incident.
        cases: names in :data:`CASES`.
    """
    text = config.model_dump_json()
    todo = [IncidentJob(text, CASES[name], seed, trial) for name in cases for trial in range(trials)]
    ends = run_all(incident_job, todo, workers, "incidents")
    ended: dict[str, list[str]] = {}
    rows, wrong = [], []
    for i, name in enumerate(cases):
        mine = ends[i * trials : (i + 1) * trials]
        ended[name] = sorted({end.ended for end in mine})
        right = [is_right(CASES[name], end) for end in mine]
        rows.append(row("davpc", name, trials, {"as_safety_says": sum(right), "docked": _count(mine, "done")}))
        wrong += [f"{name}, trial {k}: {end}" for k, end in enumerate(mine) if not right[k]]
    settings = {
        "trials": trials,
        "ends": ended,
        "expected": {name: CASES[name].ends for name in cases},
        "missed": wrong,
    }
    return write_results(out, "incidents", seed, settings, rows, [], config, missed_note(wrong))


def is_right(case: Incident, end: End) -> bool:
    """Whether it ended as ``docs/safety.md`` demands."""
    if not (end.happened and end.still and end.reported and end.slow and end.ended in case.ends):
        return False
    if case.pauses and not (end.paused and bool(end.searches) == (case.pauses == "search")):
        return False
    if (case.never_arms and end.armed) or (case.rearms and not end.rearmed):
        return False
    if end.ended == "done":
        return case.names in end.paused
    return end.latched_rightly and end.held and case.names in end.cause


def incident_job(job: IncidentJob) -> End:
    """One run."""
    config, case = Config.model_validate_json(job.config_text), job.case
    draws = np.random.default_rng((job.seed, job.trial, len(case.name)))
    start = [float(s + draws.uniform(-w, w)) for s, w in zip(START, SPREAD, strict=True)]
    start[0] += config.docking.trolley_pitch_m * (case.first - 1)
    mishap = _Mishap(case, int(draws.integers(len(config.leds.points))), config.supervisor.reduced_speed_m_s)
    count = case.trolley - case.first + 1
    what = plan(config, first=case.first, count=count, start=start, seed=int(draws.integers(2**31)))
    docking = run_plan(what, mishap, linger_s=_LINGER_S)[-1]
    ended = "done" if docking.done else cause_code(docking.cause) or f"not locked in {docking.phase}"
    report = docking.report or {}
    return End(
        ended=ended,
        cause=docking.cause,
        still=mishap.still,
        held=mishap.held,
        latched_rightly=docking.phase != "aborted" or docking.needs_reset == must_latch(docking),
        happened=mishap.began_ns is not None and docking.trolley == case.trolley,
        reported=report_agrees(report, docking),
        armed=docking.ever_armed,
        paused="; ".join(report.get("pauses", {})),
        searches=report.get("searches", 0),
        rearmed=report.get("rearmed", 0),
        slow=not mishap.fast,
        phases=tuple(phase for phase, _ in docking.phases_s),
    )


def must_latch(docking: Docking) -> bool:
    """After S2, and after whatever ends in contact."""
    touched = any(phase in ("insert", "push", "lock", "release", "retract") for phase, _ in docking.phases_s)
    return touched or needs_reset(docking.cause)


def report_agrees(report: dict[str, Any], docking: Docking) -> bool:
    """Whether the record on disk agrees on the end, its cause and the reset that it needs."""
    recorded = report.get("docked"), report.get("cause"), report.get("code"), report.get("needs_reset")
    return recorded == (docking.phase == "done", docking.cause, cause_code(docking.cause), docking.needs_reset)


class _Mishap:
    """Triggers one incident, and observes until the end."""

    def __init__(self, case: Incident, led: int, reduced_m_s: float) -> None:
        self._case, self._led, self._reduced_m_s = case, led, reduced_m_s
        self.began_ns: int | None = None
        self.still = self.held = self.fast = False
        self._entered_ns: int | None = None
        self._phase: Phase = "idle"
        self._approach_ns: int | None = None
        self._shown_ns: int | None = None

    def __call__(self, now_ns: int, phase: Phase, stage: Backstage) -> None:
        case, plant = self._case, stage.world.plant
        self.still = abs(plant.v_m_s) < _STANDING_M_S
        self.held = plant.arms.holding
        if phase != self._phase:
            self._phase = phase
            self._approach_ns = now_ns if phase == "approach" else None
        self._show_or_hide(now_ns, stage)
        if self._entered_ns is None and phase == case.phase:
            self._entered_ns = now_ns
        if self._entered_ns is None:
            return
        if self.began_ns is None and now_ns - self._entered_ns >= case.delay_s * NS_PER_S:
            self.began_ns = now_ns
            self._begin(now_ns, stage)
        both_ns = max(self.began_ns or now_ns, self._approach_ns or now_ns)
        lasts = self.began_ns is not None and now_ns - self.began_ns < case.duration_s * NS_PER_S
        if case.deed == "slip":
            plant.floor_grip = _WET_GRIP if lasts else 1.0
        if case.deed == "stall" and not lasts:
            stage.executor.resume("follower-controller")
        if case.deed == "led" and now_ns - both_ns > _SLOWED_S * NS_PER_S:
            self.fast = self.fast or plant.v_m_s > self._reduced_m_s + _STANDING_M_S

    def _show_or_hide(self, now_ns: int, stage: Backstage) -> None:
        """End the occlusion of the LEDs; an incident in a search first needs one that leads to a search."""
        if self._shown_ns is not None and now_ns >= self._shown_ns:
            stage.world.plant.occluders = ()
        waited = self._approach_ns is not None and now_ns - self._approach_ns >= _SEARCH_AFTER_S * NS_PER_S
        if self._case.phase == "search" and self._shown_ns is None and waited:
            self._hide(now_ns, _SEARCH_HIDDEN_S, stage)

    def _hide(self, now_ns: int, duration_s: float, stage: Backstage) -> None:
        pose = stage.world.plant.pose
        stage.world.plant.occluders = ((pose.x_m + _OCCLUDER_AHEAD_M, 0.5 * pose.y_m, _OCCLUDER_RADIUS_M),)
        self._shown_ns = now_ns + round(duration_s * NS_PER_S)

    def _begin(self, now_ns: int, stage: Backstage) -> None:
        plant = stage.world.plant
        faults = plant.leader.faults
        match self._case.deed:
            case "hide":
                self._hide(now_ns, self._case.duration_s, stage)
            case "jam":
                plant.contact.jam_m = self._case.jam_m
            case "bolt":
                faults.bolt_blocked = True
            case "switch_open":
                faults.stuck["lock_extended"] = False
            case "switch_closed":
                faults.stuck["lock_extended"] = True
            case "led":
                faults.dead_leds.add(self._led)
            case "stall":
                stage.executor.halt("follower-controller")
            case "leader":
                faults.powered = False
                stage.executor.halt("leader")


def _count(ends: list[End], ended: str) -> int:
    return sum(end.ended == ended for end in ends)
