"""``davpc experiment load``: both robots dock as real processes, with their network, under one load after the other.

``results.json``: a row per load. A gap of more than 120 ms in the commands on the bus must be a stop, nothing may end
a process, each docking ends by name, and 1 s after a load everything must be as fresh as its channel wants it.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import common
from common.config import default_config_path
from common.errors import ConfigError, DeviceError
from common.timing import NS_PER_MS, NS_PER_S
from experiments.load.plot import draw_loads
from experiments.load.stress import Site, Start, burn, impostor, knock, stranger, subscribe, under, write
from experiments.load.watch import GAP, LIMITS_NS, LoadWatch
from experiments.shared.fleet import Fleet
from experiments.shared.operator import Operator
from experiments.shared.results import missed_note, row, write_results
from experiments.stop_times.watch import Canary

CORES = os.cpu_count() or 1
LOADS: dict[str, tuple[Callable[[Site, Start], None], ...]] = {
    "nothing": (),
    "cpu": (burn,) * 2 * CORES,
    "disk": (write,) * 2,
    "stranger": (stranger,),
    "impostor": (impostor,),
    "ports": (knock,),
    "subscribers": (subscribe,),
    "everything": (*(burn,) * 2 * CORES, write, write, stranger, impostor, knock, subscribe),
}
MOST_RECOVERY_S = 1.0
# as in docs/safety.md P01: a host that stood still for longer makes gaps of its own
HOST_STALL_MS = 20.0
_OBSERVED_S, _LOOK_S, _BEGIN_S = 3.0, 0.002, 180.0
_PRIORITY = 70
_PEOPLE = ("follower", "leader", "stranger")


@dataclass
class Loaded:
    """One load: what was seen, and what of it must not be."""

    name: str
    worst_ms: dict[str, float] = field(default_factory=dict)
    missed: dict[str, int] = field(default_factory=dict)
    order: list[str] = field(default_factory=list)
    image_to_can_ms: float = 0.0
    gaps_without_stop: int = 0
    recovery_s: float = 0.0
    host_ms: float = 0.0
    died: list[str] = field(default_factory=list)

    @property
    def wrong(self) -> list[str]:
        """What must not be, a line each."""
        found = [f"process {name} ended" for name in self.died]
        if self.gaps_without_stop:
            found.append(
                f"{self.gaps_without_stop} gaps in the commands without a stop, up to {self.worst_ms[GAP]:.0f} ms"
            )
        if self.recovery_s > MOST_RECOVERY_S:
            found.append(f"back to normal only after {self.recovery_s:.1f} s")
        stalled = f" (the host stood still for {self.host_ms:.0f} ms)" if self.host_ms > HOST_STALL_MS else ""
        return [f"{self.name}: {what}{stalled}" for what in found]


def run(
    out: Path,
    config_path: Path | None,
    seconds: float,
    overrides: Sequence[str],
    progress: Callable[[str], None],
    names: Sequence[str] = tuple(LOADS),
) -> dict[str, Any]:
    """Dock under each load; write ``results.json``, ``table.md`` and ``load.png``.

    Args:
        out: folder for the results and the logs.
        config_path: TOML file of the pair; None: the reference.
        seconds: of each load.
        overrides: of the configuration.
        progress: takes a line a load.
        names: of :data:`LOADS`.
    """
    logs = out / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(PermissionError):  # the watch must not be late; the canary shows where that is refused
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    done: list[Loaded] = []
    operator = Operator()
    with (
        tempfile.TemporaryDirectory(prefix="davpc-pki-") as folder,
        Fleet(config_path or default_config_path(), logs, overrides, _certificates(Path(folder))) as fleet,
        _Bench(fleet, operator) as bench,
    ):
        site = Site(
            runtime=fleet.runtime,
            namespace=fleet.config.network.namespace,
            ports=fleet.ports,
            credentials=Path(folder),
            disk=out,
        )
        for name in names:
            done.append(bench.load(name, site, seconds))
            progress(f"load: {name}: {'; '.join(done[-1].wrong) or 'right'}")
        config = fleet.config
        bench.finish()
    wrong = [line for each in done for line in each.wrong]
    if operator.given_up or not operator.ends["done"]:
        wrong.append(f"no docking any more: {operator.given_up or 'none was done'}")
    settings = {
        "seconds": seconds,
        "dockings": dict(operator.ends),
        "order": {each.name: each.order for each in done},
        "missed_periods": {each.name: each.missed for each in done},
        "missed": wrong,
    }
    lines = [f"- {each.name}: {'; '.join(each.order) or 'nothing gives'}" for each in done]
    note = "\n".join(["What gives, in order of time:", "", *lines, "", missed_note(wrong)])
    results = write_results(out, "load", 0, settings, [_row(each) for each in done], [], config, note)
    draw_loads(results, out / "load.png")
    return results


def _row(each: Loaded) -> dict[str, Any]:
    ages = {f"{name} ms": each.worst_ms.get(name) for name in LIMITS_NS}
    metrics = {
        **ages,
        "image to bus ms": each.image_to_can_ms,
        "missed periods": sum(each.missed.values()),
        "gaps without stop": each.gaps_without_stop,
        "normal after s": each.recovery_s,
        "host stood still ms": each.host_ms,
    }
    return row(each.name, "", 1, metrics)


class _Bench:
    """An operator who docks one trolley after the other, and the watch beside him; a context manager."""

    def __init__(self, fleet: Fleet, operator: Operator) -> None:
        self._fleet, self._operator = fleet, operator
        self._begin_s = time.monotonic()
        self._tap = fleet.tap(_PRIORITY)
        self._canaries = [Canary(cpu) for cpu in sorted(os.sched_getaffinity(0))]
        self._watch = LoadWatch(fleet, self._tap.notes)

    def __enter__(self) -> _Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self._tap.close()
        for canary in self._canaries:
            canary.close()

    def load(self, name: str, site: Site, seconds: float) -> Loaded:
        """Wait until a docking approaches, load, and look on for a while afterwards."""
        self._until(self._approaches, _BEGIN_S)
        found = Loaded(name)
        with _children_at_ordinary_priority(), under(LOADS[name], site):
            self._watch.restart()
            for canary in self._canaries:
                canary.restart()
            self._until(lambda: False, seconds)
        ended_ns = time.monotonic_ns()
        self._until(lambda: False, _OBSERVED_S)
        ages = self._watch.ages
        found.worst_ms = {what: age_ns / NS_PER_MS for what, age_ns in ages.worst_ns.items()}
        found.missed, found.order = self._watch.missed(), ages.order
        found.image_to_can_ms = self._watch.image_to_can_ns / NS_PER_MS
        found.gaps_without_stop = self._tap.notes.gaps_without_stop
        found.recovery_s = max(0.0, ((ages.last_over_ns or 0) - ended_ns) / NS_PER_S)
        found.host_ms = max(canary.worst_ms() for canary in self._canaries)
        found.died = [each for each, child in self._fleet.children.items() if child.poll() is not None]
        self._fleet.start_missing()
        return found

    def finish(self) -> None:
        """Wait until the docking that is under way has ended."""
        ends = sum(self._operator.ends.values())
        self._until(lambda: sum(self._operator.ends.values()) > ends or bool(self._operator.given_up), _BEGIN_S)

    def _approaches(self) -> bool:
        mission = self._fleet.mission
        return mission is not None and mission.phase == "approach" and self._tap.notes.speed_counts() > 0

    def _until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Operate and look until the condition holds, or for that long."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s and not condition():
            self._fleet.operate(self._operator, time.monotonic() - self._begin_s)
            self._watch.look()
            time.sleep(_LOOK_S)


@contextlib.contextmanager
def _children_at_ordinary_priority() -> Any:
    """Processes started meanwhile do not inherit this one's priority."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    if policy == os.SCHED_FIFO:
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)
    yield


def _certificates(folder: Path) -> Path:
    """An authority of this run, with certificates for both robots and a stranger.

    Raises:
        ConfigError: openssl is missing, or this is no checkout with ``deploy/pki.sh``.
    """
    script = Path(common.__file__).parents[1] / "deploy/pki.sh"
    if not script.is_file() or shutil.which("openssl") is None:
        raise ConfigError(f"the load experiment makes certificates: it needs openssl and {script}")
    for command in (["ca"], *(["issue", name, "--host", "127.0.0.1"] for name in _PEOPLE)):
        made = subprocess.run(
            [str(script), "--dir", str(folder), *command], capture_output=True, text=True, check=False
        )
        if made.returncode:
            raise DeviceError(f"{script}: {made.stderr.strip()}")
    return folder
