"""``davpc experiment campaign``: every row of docs/safety.md, in every phase in which it matters.

``results.json``: method is the row's id, case the phase; metrics are counts, but ``max_ms``. What was done is on disk
after each run: the same call with the same folder goes on where it stopped.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from common.config import Config
from experiments.campaign.controls import CONTROLS, STAND_IN
from experiments.campaign.judge import Verdict
from experiments.campaign.plot import draw_matrix, matrix
from experiments.campaign.rows import ROWS
from experiments.campaign.trunk import PHASES, FaultTask, run_seed
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results
from experiments.shared.unfinished import Unfinished, file_of, finished

TO_THE_END = 10
"""One seed in so many follows the dockings of a row to their end, each row in another seed."""


@dataclass(frozen=True)
class Job:
    """One seed: its tasks, and the file that keeps what came of them."""

    config_text: str
    seed: int
    tasks: tuple[FaultTask, ...]
    kept: str


def run(
    out: Path,
    seed: int,
    workers: Workers,
    config: Config,
    seeds: int = 25,
    rows: tuple[str, ...] = tuple(ROWS),
    controls: bool = False,
    phases: tuple[str, ...] = PHASES,
    measured: tuple[Sequence[dict[str, Any]], Sequence[str]] = ((), ()),
) -> dict[str, Any]:
    """Run the rows in ``seeds`` seeds from ``seed`` on; write ``results.json``, ``table.md`` and ``matrix.png``.

    Args:
        out: folder for the results; what an interrupted call left there is taken up.
        seed: the first one.
        workers: who shares the work.
        config: the robots.
        seeds: how many.
        rows: ids of :data:`experiments.campaign.rows.ROWS`.
        controls: remove one check after the other instead, and see that the rows notice.
        phases: in which faults begin.
        measured: rows of results from real processes, and what of them is not right.
    """
    text = config.model_dump_json()
    todo = []
    for i in range(seeds):
        every = control_tasks(rows) if controls else tasks_of(i, rows)
        tasks = tuple(task for task in every if task.phase in phases)
        file = file_of(out, f"seed-{seed + i:05}", text, tasks)
        todo.append(Job(text, seed + i, tasks, str(file)))
    done = _done([job for job in todo if job.tasks], workers)
    runs = [each for runs_of_seed in done for each in runs_of_seed]
    if controls:
        results = _write_controls(out, seed, seeds, config, runs)
    else:
        results = _write(out, seed, seeds, config, rows, runs, measured)
    finished(Path(job.kept) for job in todo)
    return results


def _done(todo: list[Job], workers: Workers) -> list[list[Verdict]]:
    """The runs of each seed; workers of a cluster do not see this machine's files, which are written here then."""
    if not workers.cluster:
        return run_all(seed_job, todo, workers, "campaign")
    files = {job.seed: Path(job.kept) for job in todo}
    left = [replace(job, kept="", tasks=_left(job.tasks, _file(files[job.seed]).read())) for job in todo]
    run_all(
        seed_job,
        [job for job in left if job.tasks],
        workers,
        "campaign",
        keep=lambda job, runs: _file(files[job.seed]).keep(runs),
    )
    return [seed_job(job) for job in todo]


def tasks_of(index: int, rows: Sequence[str]) -> tuple[FaultTask, ...]:
    """What is done in the seed of this index."""
    numbers = {name: number for number, name in enumerate(ROWS)}
    return tuple(
        FaultTask(
            row=name,
            phase=phase,
            fault=fault,
            to_end=bool(ROWS[name].ends) and not (index + numbers[name]) % TO_THE_END,
        )
        for name in rows
        for phase, fault in (ROWS[name].tasks(index) if ROWS[name].faults else ())
    )


def control_tasks(rows: Sequence[str]) -> tuple[FaultTask, ...]:
    """Every check removed in turn, with all faults of the rows that ought to notice, beside runs with the check."""
    tasks: dict[FaultTask, None] = {}
    for name, control in CONTROLS.items():
        for row_id in control.rows:
            if row_id not in rows:
                continue
            for phase in (set(control.phases) & set(ROWS[row_id].phases)) or set(ROWS[row_id].phases[:1]):
                for fault in ROWS[row_id].usable(phase):
                    tasks[FaultTask(row=row_id, phase=phase, fault=fault)] = None
                    tasks[FaultTask(row=row_id, phase=phase, fault=fault, control=name)] = None
    return tuple(tasks)


def seed_job(job: Job) -> list[Verdict]:
    """Run what of one seed is not in its file yet, and keep each run there as it is done; all of them, in order."""
    if not job.kept:
        return list(run_seed(job.config_text, job.seed, job.tasks))
    file = _file(Path(job.kept))
    runs = {_key(each): each for each in file.read()}
    left = _left(job.tasks, list(runs.values()))
    if left:
        for each in run_seed(job.config_text, job.seed, left):
            runs[_key(each)] = each
            file.keep([each])
    return [runs[_key(task)] for task in job.tasks]


def _file(path: Path) -> Unfinished[Verdict]:
    return Unfinished(path, Verdict)


def _left(tasks: tuple[FaultTask, ...], runs: Sequence[Verdict]) -> tuple[FaultTask, ...]:
    done = {_key(each) for each in runs}
    return tuple(task for task in tasks if _key(task) not in done)


def _key(of: FaultTask | Verdict) -> tuple[str, ...]:
    return of.row, of.phase, of.fault, of.control


def counted(runs: Sequence[Verdict]) -> dict[str, float | None]:
    """The metrics of runs of one row in one phase."""
    times = [each.ms for each in runs if each.ms is not None]
    return {
        "unsafe": sum(bool(each.unsafe) for each in runs),
        "wrong_reaction": sum(each.wrong_reaction for each in runs),
        "wrong_cause": sum(each.wrong_cause for each in runs),
        "late": sum(each.late for each in runs),
        "max_ms": max(times) if times else None,
    }


def _write(
    out: Path,
    seed: int,
    seeds: int,
    config: Config,
    rows: Sequence[str],
    runs: list[Verdict],
    measured: tuple[Sequence[dict[str, Any]], Sequence[str]],
) -> dict[str, Any]:
    cells: dict[tuple[str, str], list[Verdict]] = defaultdict(list)
    for each in runs:
        cells[each.row, each.phase].append(each)
    entries = [
        row(name, phase, len(cells[name, phase]), counted(cells[name, phase]))
        for name in rows
        for phase in PHASES
        if (name, phase) in cells
    ]
    wrong = [*(each.text for each in runs if not each.right), *measured[1]]
    by = {name: ROWS[name].process for name in rows if ROWS[name].process}
    ends: dict[str, int] = defaultdict(int)
    for each in runs:
        if each.end:
            ends[each.end] += 1
    settings = {"seeds": seeds, "missed": wrong, "by": by, "ends": dict(sorted(ends.items()))}
    note = missed_note(wrong)
    results = write_results(out, "campaign", seed, settings, [*entries, *measured[0]], [], config, note)
    table = matrix(entries, rows, measured[0])
    (out / "table.md").write_text(f"{table}\n{note}\n", encoding="utf-8")
    draw_matrix(entries, rows, out / "matrix.png")
    return results


def _write_controls(out: Path, seed: int, seeds: int, config: Config, runs: list[Verdict]) -> dict[str, Any]:
    """Which row noticed that a check was gone: a run that is red, and right with the check in place."""
    right = {(r.seed, r.row, r.phase, r.fault) for r in runs if not r.control and r.right}
    entries, missed, lines = [], [], []
    for name, control in CONTROLS.items():
        mine = [r for r in runs if r.control == name and (r.seed, r.row, r.phase, r.fault) in right]
        red = [r for r in mine if not r.right]
        broken = [r for r in mine if any("the experiment failed" in why for why in r.unsafe)]
        caught = sorted({r.row for r in red if r not in broken})
        entries.append(row(name, control.layer, len(mine), {"caught": len(red) - len(broken), "broken": len(broken)}))
        nothing = f"**nothing**: {STAND_IN.get(name, 'why is not known')}"
        lines.append(f"| {name} | {', '.join(caught) or nothing} | {len(mine)} |")
        if broken or not (caught or name in STAND_IN):
            why = broken[0].text if broken else f"{len(mine)} runs of {', '.join(control.rows)} stayed right"
            missed.append(f"{name}: {why}")
    settings = {"seeds": seeds, "missed": missed}
    results = write_results(out, "campaign_controls", seed, settings, entries, [], config)
    head = "# Checks removed in turn\n\n| check | caught by | runs |\n|---|---|---|\n"
    text = head + "\n".join(lines) + "\n\n" + missed_note(missed) + "\n"
    (out / "table.md").write_text(text, encoding="utf-8")
    return results
