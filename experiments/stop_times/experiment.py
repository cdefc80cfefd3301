"""``davpc experiment stop-times``: how long until the wheels are commanded to stop when a process dies or hangs.

``docs/safety.md`` S01–S06, S27, S49, P01–P03. ``run`` writes ``rows`` of method, n and metrics [ms].
Controller and bridge die on their own bench, wheels lifted; camera, estimator, supervisor and arms in a whole robot.
Stop time: from the fault to the first frame that commands zero or quick stop; with the bridge dead or stopped, from
its last RPDO until both drives are in quick stop. Limits: 150 ms, 250 ms for what stands above the controller, and
120 ms for the bridge.
"""

from __future__ import annotations

import math
import signal
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from common.config import default_config_path, load_config
from common.files.writer import write_json
from common.timing import NS_PER_MS, MonotonicClock
from experiments.shared.results import configuration
from experiments.stop_times.bench import BRIDGE, CONTROLLER, StopBench
from experiments.stop_times.robot import StopRobot

HOST_STALL_MS = 20.0
MAX_REPEATS = 10
_OBSERVED_S = 0.5
_RESUMED_S = 0.3


@dataclass(frozen=True)
class Method:
    """A fault: what is sent to which process, how long the stop may take [ms], and its share of the trials."""

    name: str
    limit_ms: float
    process: str
    number: signal.Signals
    share: float


METHODS = (
    Method("controller_kill", 150, CONTROLLER, signal.SIGKILL, 1.0),
    Method("controller_stop", 150, CONTROLLER, signal.SIGSTOP, 1.0),
    Method("bridge_kill", 120, BRIDGE, signal.SIGKILL, 0.5),
    Method("bridge_stop", 120, BRIDGE, signal.SIGSTOP, 0.5),
)
ROBOT_METHODS = tuple(
    Method(f"{name}_kill", 250, f"follower-{name}", signal.SIGKILL, 0.3)
    for name in ("camera", "estimator", "supervisor", "arms")
)
STALL = "stall"
NAMES = (*(method.name for method in METHODS), STALL, *(method.name for method in ROBOT_METHODS))


@dataclass(frozen=True)
class Trial:
    """One trial: the stop time, the host's longest pause meanwhile, frames that moved the wheels afterwards."""

    stop_ms: float
    host_ms: float
    moved_after: int


def run(
    out: Path,
    config_path: Path | None = None,
    trials: int = 100,
    stalls: int = 50,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _line: None,
    names: tuple[str, ...] = NAMES,
) -> dict[str, Any]:
    """Measure every method; results are on disk after each.

    Args:
        out: folder for results and logs; made if missing.
        config_path: the robots; None: the default configuration.
        trials: of each fault of the controller; the bridge gets half as many, the others three tenths.
        stalls: of controller or bridge, 0.2 to 10 s long.
        seed: random seed of the moments of the faults.
        progress: takes one line per method.
        names: which of :data:`NAMES`.
    """
    config_path = config_path or default_config_path()
    out.mkdir(parents=True, exist_ok=True)
    random = Random(seed)
    rows: list[dict[str, Any]] = []
    results: dict[str, Any] = {
        "experiment": "stop_times",
        "settings": configuration(load_config(config_path)),
        "seed": seed,
        "rows": rows,
        "complete": False,
        "passed": False,
    }
    write_json(out / "results.json", results)

    def note(row: dict[str, Any]) -> None:
        rows.append(row)
        write_json(out / "results.json", results)
        progress(_line(row))

    chosen, on_robot = ([each for each in every if each.name in names] for every in (METHODS, ROBOT_METHODS))
    stalls = stalls if STALL in names else 0
    if chosen or stalls:
        with (
            tempfile.TemporaryDirectory(prefix="davpc-") as runtime,
            StopBench(config_path, Path(runtime), out) as bench,
        ):
            for method in chosen:
                note(_row(method, _trials(lambda m=method: _trial(bench, m, random), method, trials)))  # type: ignore[misc]
            if stalls:
                note(_stall_row(bench, stalls, random))
    if on_robot:
        with StopRobot(config_path, out) as robot:
            for method in on_robot:
                note(_row(method, _trials(lambda m=method: _robot_trial(robot, m, random), method, trials)))  # type: ignore[misc]
    results |= {"complete": True, "passed": all(row["passed"] for row in rows)}
    return write_json(out / "results.json", results)


def _trials(one: Callable[[], Trial], method: Method, trials: int) -> tuple[list[Trial], int]:
    """Trials, and how many had to be repeated: those too slow while the host itself stalled.

    A stall of the host can only delay a stop: a trial that keeps its limit in spite of one counts.
    """
    count = math.ceil(trials * method.share)
    kept: list[Trial] = []
    repeated = 0
    while len(kept) < count:
        trial = one()
        if trial.stop_ms > method.limit_ms and trial.host_ms > HOST_STALL_MS and repeated < MAX_REPEATS * count:
            repeated += 1
            continue
        kept.append(trial)
    return kept, repeated


def _robot_trial(robot: StopRobot, method: Method, random: Random) -> Trial:
    """One process of the whole robot dies under way; from then to the first frames that stop the wheels."""
    robot.get_under_way()
    robot.pause(random.uniform(0.0, 0.1))
    robot.canary.restart()
    robot.watch.restart()
    fault_ns = MonotonicClock().now_ns()
    robot.kill(method.process)
    robot.pause(_OBSERVED_S)
    watch = robot.watch
    stop_ms = (watch.commanded_ns - fault_ns) / NS_PER_MS if watch.commanded_ns is not None else float("inf")
    return Trial(stop_ms, robot.canary.worst_ms(), watch.moved_after_stop)


def _trial(bench: StopBench, method: Method, random: Random) -> Trial:
    bench.get_under_way()
    bench.pause(random.uniform(0.0, 0.1))
    clock, watch = MonotonicClock(), bench.watch
    bench.canary.restart()
    watch.restart()
    fault_ns = clock.now_ns()
    bench.signal(method.process, method.number)
    bench.pause(_OBSERVED_S)
    host_ms = bench.canary.worst_ms()
    from_ns, stop_ns = fault_ns, watch.commanded_ns
    if method.process == BRIDGE:
        from_ns, stop_ns = watch.last_rpdo_ns or fault_ns, watch.stopped_ns
    if method.number == signal.SIGSTOP:
        bench.signal(method.process, signal.SIGCONT)
        bench.pause(_RESUMED_S)
    stop_ms = (stop_ns - from_ns) / NS_PER_MS if stop_ns is not None else float("inf")
    return Trial(stop_ms, host_ms, watch.moved_after_stop)


def _row(method: Method, measured: tuple[list[Trial], int]) -> dict[str, Any]:
    kept, repeated = measured
    times = sorted(trial.stop_ms for trial in kept)
    moved = sum(trial.moved_after for trial in kept)
    return {
        "method": method.name,
        "n": len(times),
        "limit_ms": method.limit_ms,
        "metrics": {
            "median_ms": statistics.median(times),
            "p95_ms": times[max(0, -(-95 * len(times) // 100) - 1)],
            "max_ms": times[-1],
        },
        "frames_moving_after_stop": moved,
        "kept_with_host_stalls": sum(trial.host_ms > HOST_STALL_MS for trial in kept),
        "repeated_for_host_stalls": repeated,
        "passed": times[-1] <= method.limit_ms and moved == 0,
    }


def _stall_row(bench: StopBench, count: int, random: Random) -> dict[str, Any]:
    """Stalls of 0.2 to 10 s: afterwards nothing of what was commanded before may move the wheels."""
    stale = 0
    for _ in range(count):
        bench.get_under_way()
        name = random.choice((CONTROLLER, BRIDGE))
        bench.watch.restart()
        bench.signal(name, signal.SIGSTOP)
        bench.pause(random.uniform(0.2, 10.0))
        bench.signal(name, signal.SIGCONT)
        bench.pause(_RESUMED_S)
        stale += bench.watch.moved_after_stop
    return {"method": STALL, "n": count, "metrics": {"stale_setpoints": stale}, "passed": stale == 0}


def _line(row: dict[str, Any]) -> str:
    metrics = ", ".join(f"{name} {value:.1f}" for name, value in row["metrics"].items())
    return f"{row['method']}: n {row['n']}, {metrics}: {'ok' if row['passed'] else 'FAILED'}"
