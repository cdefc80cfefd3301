"""A docking of two robots that share nothing but their gateways, while an attacker sends garbage to their ports."""

from __future__ import annotations

import random
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from common.processes import ONE_MACHINE
from gateway.access import Robot
from tests.net.gateways import Gateways, needs_openssl
from tests.net.rogue import first_packets, resident_mb
from tests.rigs.sim_run import is_docked, judged_on_a_calm_host
from tests.rigs.waiting import until

pytestmark = [pytest.mark.alone, needs_openssl]
GROWTH_MB = 5.0


def free_tcp_port() -> int:
    """A free port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@contextmanager
def two_robots(certificates: Path, folder: Path, *settings: str) -> Iterator[Gateways]:
    """All processes of both robots and the world, each robot in a mesh of its own."""
    can = free_tcp_port()
    buses = [f"{bus}.bus.port={can}" for bus in ("follower_can", "leader_can")]
    pair = Gateways(certificates, "davpc", *buses, "world.start=[3.0,0.15,3.0]", "world.seed=3", *settings)
    logs = Path(tempfile.mkdtemp(prefix="robots", dir=folder))
    with ExitStack() as stack:
        stack.callback(pair.close)
        for entry in ONE_MACHINE:
            robot: Robot = "leader" if entry.robot == "leader" else "follower"
            child = stack.enter_context(pair.spawned(entry.name, robot, logs / f"{entry.name}.log"))
            stack.callback(child.terminate)
            if entry.robot == "world":  # who opens a bus needs its server there
                until((pair.runtime("follower") / "world.alive").exists, 90)
        pair.linked()
        yield pair


@judged_on_a_calm_host(stepped="tests/stepped/test_sim.py::test_stepped_dockings_are_bit_identical")
def test_they_dock_under_garbage_half_open_connections_and_floods(
    sim_run: Any, certificates: Path, tmp_path: Path
) -> None:
    chance = random.Random(11)
    packets = first_packets(20, certificates / "ca.pem", certificates / "leader")
    with two_robots(certificates, tmp_path) as pair, ExitStack() as links:
        run = sim_run("--attach", str(pair.runtime("follower")), *pair.options())
        run.wait_for("approach")
        before = {robot: resident_mb(child.pid) for robot, child in pair.running.items()}
        doors = [("127.0.0.1", port) for port in pair.ports.values()]
        for packet in packets:
            for door in doors:
                link = links.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                link.sendto(packet, door)
                for _ in range(100):
                    link.sendto(chance.randbytes(chance.randint(1, 1400)), door)
        code = run.finish()
        grown = {robot: resident_mb(child.pid) - before[robot] for robot, child in pair.running.items()}
    results = run.results()
    assert code == 0, "".join(run.lines)
    assert is_docked(results), results
    assert all(megabytes <= GROWTH_MB for megabytes in grown.values()), grown


@judged_on_a_calm_host(
    stepped="tests/stepped/test_link.py::test_without_the_link_the_approach_goes_on_and_the_lock_step_ends_by_name"
)
def test_without_the_link_the_approach_goes_on_and_the_lock_step_ends_by_name(
    sim_run: Any, certificates: Path, tmp_path: Path
) -> None:
    with two_robots(certificates, tmp_path, "supervisor.link_timeout_s=5.0") as pair:
        run = sim_run("--attach", str(pair.runtime("follower")), *pair.options())
        run.wait_for("approach")
        pair.running["leader"].terminate()
        code = run.finish()
    results = run.results()
    assert code == 1, "".join(run.lines)
    assert results["cause"] == "leader_silent", results
    assert "lock" in results["phases_s"]
    assert "release" not in results["phases_s"]
