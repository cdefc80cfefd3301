"""What goes wrong at a collection, and what the robots do: ``davpc experiment incidents``.

Each case is done in several seeds; its end must be that of the safety concept, with the right cause, at standstill,
and with the trolley still held where anything is in contact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from common.causes import cause_code, needs_reset
from common.config import Config
from common.messages import Phase
from common.timing import NS_PER_S
from experiments.campaign import run_all
from experiments.queue_run import Backstage, Docking, plan, run_plan
from experiments.results import row, write_results

START, SPREAD = (3.6, 0.25, 0.0), (0.15, 0.15, 4.0)
_STANDING_M_S = 0.01
_OCCLUDER_AHEAD_M, _OCCLUDER_RADIUS_M = 1.9, 0.45
_LINGER_S = 1.0
Deed = Callable[[Backstage, int], None]


@dataclass(frozen=True)
class Case:
    """One incident: in which phase and how long after its begin, for how long, what may come of it.

    ``ends``: the causes that are right, "done" for a docking that succeeds. ``holds``: the trolley stays gripped when
    it does not. ``jam_m``: how far before its place the trolley is blocked.
    """

    name: str
    deed: Literal["hide", "jam", "switch_open", "switch_closed", "led", "leader"]
    phase: Phase
    ends: tuple[str, ...]
    trolley: int = 1
    delay_s: float = 0.2
    duration_s: float = 0.0
    holds: bool = True
    jam_m: float = 0.08


_LED_PHASES: tuple[Phase, ...] = ("acquire", "approach", "insert", "push", "lock", "release", "retract")
_OFF_ENDS: dict[Phase, tuple[str, ...]] = {
    "acquire": ("leader_lost", "acquire_timeout", "leds_lost"),
    "approach": ("leader_lost",),
    "insert": ("leader_lost",),
    "push": ("leader_lost",),
    "lock": ("leader_silent", "leader_lost"),
    "release": ("done",),
    "retract": ("done",),
}
CASES = {
    case.name: case
    for case in (
        Case("hidden 0.3 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=0.3),
        Case("hidden 1 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=1.0),
        Case("hidden 5 s", "hide", "approach", ("done",), delay_s=2.0, duration_s=5.0),
        Case("jam of trolley 1", "jam", "approach", ("contact_early",)),
        # so near its place only the seat's switch tells
        Case("late jam of trolley 1", "jam", "approach", ("contact_early", "lock_refused"), jam_m=0.05),
        Case("jam of trolley 2", "jam", "approach", ("contact_early",), trolley=2),
        Case(
            "late jam of trolley 2", "jam", "approach", ("contact_early", "contact_elsewhere"), trolley=2, jam_m=0.05
        ),
        Case("lock switch stuck open", "switch_open", "approach", ("lock_refused", "lock_timeout")),
        Case("lock switch stuck closed", "switch_closed", "idle", ("acquire_timeout", "lock_implausible")),
        *(Case(f"LED dies in {phase}", "led", phase, ("done", "few_leds"), holds=False) for phase in _LED_PHASES),
        *(Case(f"Leader off in {phase}", "leader", phase, ends) for phase, ends in _OFF_ENDS.items()),
    )
}


@dataclass(frozen=True)
class Job:
    """One incident in one seed."""

    config_text: str
    case: Case
    seed: int
    trial: int


@dataclass(frozen=True)
class End:
    """How it ended: cause or "done", whether it stood still and what it held, the phases on the way."""

    ended: str
    still: bool
    held: bool
    latched_rightly: bool
    happened: bool
    phases: tuple[Phase, ...]


def run(
    out: Path, seed: int, jobs: int, config: Config, trials: int = 5, cases: tuple[str, ...] = tuple(CASES)
) -> dict[str, Any]:
    """Run every case ``trials`` times; write ``results.json`` and ``table.md``."""
    text = config.model_dump_json()
    todo = [Job(text, CASES[name], seed, trial) for name in cases for trial in range(trials)]
    ends = run_all(incident_job, todo, jobs, "incidents")
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
        "wrong": wrong,
    }
    return write_results(out, "incidents", seed, settings, rows, [], config)


def is_right(case: Case, end: End) -> bool:
    """Whether it ended as the safety concept says."""
    if not (end.happened and end.still and end.ended in case.ends):
        return False
    return end.ended == "done" or (end.latched_rightly and (end.held or not case.holds))


def incident_job(job: Job) -> End:
    """One run."""
    config, case = Config.model_validate_json(job.config_text), job.case
    draws = np.random.default_rng((job.seed, job.trial, len(case.name)))
    start = [float(s + draws.uniform(-w, w)) for s, w in zip(START, SPREAD, strict=True)]
    start[0] += config.docking.trolley_pitch_m * (case.trolley - 1)
    mishap = _Mishap(case, int(draws.integers(len(config.leds.points))))
    what = plan(config, first=case.trolley, start=start, seed=int(draws.integers(2**31)))
    docking = run_plan(what, mishap, linger_s=_LINGER_S)[-1]
    ended = "done" if docking.done else cause_code(docking.cause) or f"not locked in {docking.phase}"
    right = docking.phase != "aborted" or docking.needs_reset == needs_reset(docking.cause)
    return End(ended, mishap.still, mishap.held, right, mishap.began_ns is not None, _phases(docking))


class _Mishap:
    """Lets one incident happen, and looks on until the end."""

    def __init__(self, case: Case, led: int) -> None:
        self._case, self._led = case, led
        self.began_ns: int | None = None
        self.still = self.held = False
        self._entered_ns: int | None = None
        self._over = False

    def __call__(self, now_ns: int, phase: Phase, stage: Backstage) -> None:
        case, plant = self._case, stage.world.plant
        self.still = abs(plant.v_m_s) < _STANDING_M_S
        self.held = plant.arms.holding
        if self._entered_ns is None and phase == case.phase:
            self._entered_ns = now_ns
        if self._entered_ns is None:
            return
        if self.began_ns is None and now_ns - self._entered_ns >= case.delay_s * NS_PER_S:
            self.began_ns = now_ns
            self._begin(stage)
        ends_ns = case.duration_s * NS_PER_S
        if not self._over and ends_ns and self.began_ns is not None and now_ns - self.began_ns >= ends_ns:
            self._over = True
            plant.occluders = ()

    def _begin(self, stage: Backstage) -> None:
        plant = stage.world.plant
        faults = plant.leader.faults
        match self._case.deed:
            case "hide":
                x = plant.pose.x_m + _OCCLUDER_AHEAD_M
                plant.occluders = ((x, 0.5 * plant.pose.y_m, _OCCLUDER_RADIUS_M),)
            case "jam":
                plant.contact.jam_m = self._case.jam_m
            case "switch_open":
                faults.stuck["lock_extended"] = False
            case "switch_closed":
                faults.stuck["lock_extended"] = True
            case "led":
                faults.dead_leds.add(self._led)
            case "leader":
                faults.powered = False
                stage.executor.halt("leader")


def _phases(docking: Docking) -> tuple[Phase, ...]:
    return tuple(phase for phase, _ in docking.phases_s)


def _count(ends: list[End], ended: str) -> int:
    return sum(end.ended == ended for end in ends)
