"""Many runs by several workers: the same results in the same order, with progress and time left."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from experiments.shared.cluster import cluster_submits
from experiments.shared.worker import Children

Item = TypeVar("Item")
Result = TypeVar("Result")
Submit = Callable[[bytes], "Future[bytes]"]
# handed out at once; more would only fill the memory of a scheduler
IN_FLIGHT = 2000


@dataclass(frozen=True)
class Workers:
    """Who does the runs: ``jobs`` processes of this machine, or a dask.distributed cluster at an address."""

    jobs: int = 1
    cluster: str = ""

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: ``jobs`` is not positive.
        """
        if self.jobs < 1:
            raise ValueError(f"jobs = {self.jobs}: at least one process is needed")


ALONE = Workers()


def run_all(
    work: Callable[[Item], Result],
    todo: list[Item],
    workers: Workers,
    title: str,
    console: Console | None = None,
    keep: Callable[[Item, Result], None] = lambda _item, _result: None,
) -> list[Result]:
    """``[work(item) for item in todo]``, in the given order; a run whose process or machine is lost is repeated.

    Args:
        work: function of a module that depends on its item alone, so that the result does not depend on ``workers``.
        todo: arguments of ``work``.
        workers: who does it; with one job, this process itself.
        title: of the progress bar.
        console: for progress; None: stderr.
        keep: called with each item and its result as soon as there is one, in any order, in this process.

    Raises:
        ConfigError: the cluster cannot be used.
        DeviceError: a run lost its process too often.
    """
    console = console or Console(stderr=True)
    begin_s, total = time.monotonic(), len(todo)
    results: dict[int, Result] = {}
    with _bar(console) as progress:
        task = progress.add_task(title, total=total)
        for place, result in _finished(work, todo, workers):
            results[place] = result
            keep(todo[place], result)
            progress.advance(task)
            done = len(results)
            if not console.is_terminal and 10 * done // total > 10 * (done - 1) // total:
                console.print(_line(title, done, total, time.monotonic() - begin_s))
    return [results[place] for place in range(total)]


def _finished(work: Callable[[Item], Result], todo: list[Item], workers: Workers) -> Iterator[tuple[int, Result]]:
    """Place and result of each run, as they end."""
    if workers.jobs == 1 and not workers.cluster:
        yield from enumerate(map(work, todo))
        return
    ended: SimpleQueue[Future[bytes]] = SimpleQueue()
    places: dict[Future[bytes], int] = {}

    def next_ended() -> tuple[int, Result]:
        future = ended.get()
        good, content = pickle.loads(future.result())
        if not good:
            raise content
        return places.pop(future), content

    with cluster_submits(workers.cluster) if workers.cluster else _local_submits(workers.jobs) as submit:
        for place, item in enumerate(todo):
            future = submit(pickle.dumps((work, item)))
            places[future] = place
            future.add_done_callback(ended.put)
            while len(places) >= IN_FLIGHT or not ended.empty():
                yield next_ended()
        while places:
            yield next_ended()


@contextmanager
def _local_submits(jobs: int) -> Iterator[Submit]:
    """Processes of this machine; none is left behind, however it ends."""
    children = Children()
    threads = ThreadPoolExecutor(jobs, thread_name_prefix="runs")
    try:
        yield lambda request: threads.submit(children.do, request)
    finally:
        children.close()
        threads.shutdown(cancel_futures=True)


def _line(title: str, done: int, total: int, elapsed_s: float) -> str:
    """Progress for a log, where no bar can be drawn."""
    left_s = elapsed_s * (total - done) / done
    return f"{title}: {done} of {total} after {elapsed_s / 60:.1f} min, {left_s / 60:.1f} min left"


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
