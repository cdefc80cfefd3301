"""An experiment's runs on a cluster: a scheduler and two workers on loopback."""

from __future__ import annotations

import io
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from common.config import default_config_path, load_config
from common.errors import ConfigError, DeviceError
from experiments.campaign import experiment as campaign
from experiments.feature_level import table1
from experiments.shared.executor import ALONE, Workers, run_all
from tests.rigs.runs import Slow, fails, lost, noise, slow_noise
from tests.rigs.waiting import until

pytest.importorskip("distributed", reason="dask.distributed is not installed: pip install 'davpc[cluster]'")
pytestmark = pytest.mark.alone
ROOT = Path(__file__).parents[2]
CONFIG = load_config(default_config_path())
SILENT = Console(file=io.StringIO())


class Cluster:
    """A scheduler and its workers as processes of this machine."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        self.workers = [self.add_worker() for _ in range(2)]

    def add_worker(self) -> subprocess.Popen[bytes]:
        local = str(self._folder)
        return self._start("worker", self.address, "--nthreads", "1", "--no-dashboard", "--local-directory", local)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        path = os.pathsep.join([str(ROOT), *sys.path])
        with (self._folder / "log").open("ab") as log:
            environment = {**os.environ, "PYTHONPATH": path}
            return subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=ROOT)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.terminate()
        for process in (*self.workers, self.scheduler):
            process.wait(30)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    running = Cluster(tmp_path_factory.mktemp("cluster"))
    yield running
    running.close()


def test_a_clusters_results_are_those_of_this_machine_to_the_bit(cluster: Cluster, tmp_path: Path) -> None:
    workers = Workers(cluster=cluster.address)
    assert run_all(noise, list(range(40)), workers, "n", SILENT) == run_all(
        noise, list(range(40)), Workers(2), "n", SILENT
    )
    one, other = (
        table1.run(tmp_path / name, 2, who, CONFIG, trials=2, methods=("ibvs",), cases=("T",))
        for name, who in (("here", Workers(2)), ("there", workers))
    )
    assert one == other
    here, there = (
        campaign.run(tmp_path / f"campaign-{name}", 1, who, CONFIG, seeds=1, rows=("S28",), phases=("idle",))
        for name, who in (("here", ALONE), ("there", workers))
    )
    assert here["rows"] == there["rows"]
    with pytest.raises(ZeroDivisionError):
        run_all(fails, [1, 0], workers, "fails", SILENT)
    with pytest.raises(DeviceError, match="lost its process"):
        run_all(lost, [1], workers, "lost", SILENT)


def test_the_runs_of_a_lost_worker_are_repeated_and_a_lost_scheduler_is_named(
    cluster: Cluster, tmp_path: Path
) -> None:
    todo = [Slow(seed, 0.5, str(tmp_path)) for seed in range(12)]
    begun: list[str] = []

    def kill_one(_item: Slow, _result: list[float]) -> None:
        if not begun:
            begun.extend(os.listdir(tmp_path))
            cluster.workers[0].kill()

    results = run_all(slow_noise, todo, Workers(cluster=cluster.address), "slow", SILENT, kill_one)
    assert results == [noise(run.seed) for run in todo]
    assert len(os.listdir(tmp_path)) > len(todo), "no run was under way on the lost worker"

    def kill_scheduler(_item: Slow, _result: list[float]) -> None:
        cluster.scheduler.kill()

    with pytest.raises((ConfigError, DeviceError), match="the scheduler was lost"):
        run_all(slow_noise, todo, Workers(cluster=cluster.address), "slow", SILENT, kill_scheduler)
    until(lambda: cluster.scheduler.poll() is not None, 10.0)
