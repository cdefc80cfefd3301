"""``davpc experiment campaign``: every row of docs/safety.md, in every phase in which it matters.

``results.json``: method is the row's id, case the phase; metrics are counts, but ``max_ms``. What was done is on disk
after each run: the same call with the same folder goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from common.config import Config
from experiments.campaign.controls import CONTROLS, STAND_IN
from experiments.campaign.judge import Verdict
from experiments.campaign.plot import draw_matrix, matrix
from experiments.campaign.rows import ROWS, Row
from experiments.campaign.trunk import PHASES, FaultTask, run_seed
from experiments.shared.executor import Workers, run_all
from experiments.shared.results import missed_note, row, write_results

TO_THE_END = 10
"""One seed in so many follows the dockings of a row to their end, each row in another seed."""
_UNFINISHED = "unfinished"


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
    folder = out / _UNFINISHED
    folder.mkdir(parents=True, exist_ok=True)
    todo = []
    for i in range(seeds):
        every = control_tasks(rows) if controls else tasks_of(i, rows)
        todo.append(_job(text, seed + i, tuple(task for task in every if task.phase in phases), folder))
    done = _done([job for job in todo if job.tasks], workers)
    runs = [each for runs_of_seed in done for each in runs_of_seed]
    if controls:
        results = _write_controls(out, seed, seeds, config, runs)
    else:
        results = _write(out, seed, seeds, config, rows, runs, measured)
    shutil.rmtree(folder)
    return results


def _done(todo: list[Job], workers: Workers) -> list[list[Verdict]]:
    """The runs of each seed; workers of a cluster do not see this machine's files, which are written here then."""
    if not workers.cluster:
        return run_all(seed_job, todo, workers, "campaign")
    files = {job.seed: Path(job.kept) for job in todo}
    left = [replace(job, kept="", tasks=_left(job.tasks, _kept(files[job.seed]))) for job in todo]
    run_all(
        seed_job,
        [job for job in left if job.tasks],
        workers,
        "campaign",
        keep=lambda job, runs: _keep(files[job.seed], runs),
    )
    return [seed_job(job) for job in todo]


def _job(text: str, seed: int, tasks: tuple[FaultTask, ...], folder: Path) -> Job:
    digest = hashlib.sha256(f"{text} {tasks}".encode()).hexdigest()[:12]
    return Job(text, seed, tasks, str(folder / f"seed-{seed:05}-{digest}.jsonl"))


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


def _to_end(turn: int, row: Row) -> bool:
    return bool(row.ends) and turn % TO_THE_END == 0


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
    file = Path(job.kept)
    runs = _kept(file)
    left = _left(job.tasks, runs)
    if left:
        for each in run_seed(job.config_text, job.seed, left):
            runs.append(each)
            _keep(file, [each])
    order = {_key(task): place for place, task in enumerate(job.tasks)}
    return sorted(runs, key=lambda each: order[_key(each)])


def _kept(file: Path) -> list[Verdict]:
    """What an earlier call did; a line that was cut short is removed."""
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True) if file.exists() else []
    whole = [line for line in lines if line.endswith("\n")]
    if whole != lines:
        file.write_text("".join(whole), encoding="utf-8")
    return [Verdict(**_tuples(json.loads(line))) for line in whole]


def _keep(file: Path, runs: Sequence[Verdict]) -> None:
    with file.open("a", encoding="utf-8") as lines:
        lines.writelines(json.dumps(asdict(each), ensure_ascii=False) + "\n" for each in runs)


def _left(tasks: tuple[FaultTask, ...], runs: Sequence[Verdict]) -> tuple[FaultTask, ...]:
    done = {_key(each) for each in runs}
    return tuple(task for task in tasks if _key(task) not in done)


def _key(of: FaultTask | Verdict) -> tuple[str, ...]:
    return of.row, of.phase, of.fault, of.control


def _tuples(entry: dict[str, Any]) -> dict[str, Any]:
    return {**entry, "unsafe": tuple(entry["unsafe"])}


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
