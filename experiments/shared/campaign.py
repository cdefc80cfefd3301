"""Many runs over several processes: deterministic for a seed at any number of jobs, with progress and time left."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Item = TypeVar("Item")
Result = TypeVar("Result")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run_all(
    work: Callable[[Item], Result], jobs_to_do: list[Item], jobs: int, title: str, console: Console | None = None
) -> list[Result]:
    """``[work(job) for job in jobs_to_do]`` over ``jobs`` processes, in the given order.

    Args:
        work: function of a module that depends on its job alone, so that the result does not depend on ``jobs``.
        jobs_to_do: arguments of ``work``.
        jobs: number of processes.
        title: of the progress bar.
        console: for progress; None: stderr.

    Raises:
        ValueError: ``jobs`` is not positive.
    """
    if jobs < 1:
        raise ValueError(f"jobs = {jobs}: at least one process is needed")
    console = console or Console(stderr=True)
    begin_s, total = time.monotonic(), len(jobs_to_do)
    with _bar(console) as progress:
        task = progress.add_task(title, total=total)
        results = []
        with _mapped(work, jobs_to_do, jobs) as finished:
            for result in finished:
                results.append(result)
                progress.advance(task)
                done = len(results)
                if not console.is_terminal and 10 * done // total > 10 * (done - 1) // total:
                    console.print(_line(title, done, total, time.monotonic() - begin_s))
    return results


def _line(title: str, done: int, total: int, elapsed_s: float) -> str:
    """Progress for a log, where no bar can be drawn."""
    left_s = elapsed_s * (total - done) / done
    return f"{title}: {done} of {total} after {elapsed_s / 60:.1f} min, {left_s / 60:.1f} min left"


@contextmanager
def _mapped(work: Callable[[Item], Result], todo: list[Item], jobs: int) -> Iterator[Iterable[Result]]:
    if jobs == 1:
        yield map(work, todo)
        return
    with _one_thread_each(), multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield pool.imap(work, todo)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes spawned here give linear algebra one thread: it reads this when a process first imports numpy."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
    )
