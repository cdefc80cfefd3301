"""The compose file docks in containers, loses the robots' network on the way, and leaves nothing behind."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from common.processes import PROCESSES
from tests.docker.engine import ROOT, Deployment, Engine
from tests.rigs.host import judged_on_a_calm_host
from tests.rigs.sim_run import is_docked

COMPOSE = (ROOT / "docker/compose.yaml").read_text()
SERVICES = re.findall(
    r"^  ([a-z-]+):$", COMPOSE.partition("\nservices:")[2].partition("\nnetworks:")[0], re.MULTILINE
)
Start = Callable[[], Deployment]


def test_the_services_are_the_processes_with_an_authority_and_a_station() -> None:
    assert sorted(SERVICES) == sorted([*(entry.name for entry in PROCESSES), "authority", "station"])
    for entry in PROCESSES:
        assert f"command: [run, {entry.name}]\n" in COMPOSE
        assert f"test: [CMD, alive.sh, {entry.name}]" in COMPOSE


@pytest.fixture
def start(engine: Engine, tmp_path: Path) -> Iterator[Start]:
    """Starts deployments, and takes each down before the next."""
    running: list[Deployment] = []

    def begin() -> Deployment:
        for deployment in running:
            deployment.down()
        running.append(Deployment(engine, f"davpc{len(running)}", tmp_path / f"out{len(running)}"))
        return running[-1]

    yield begin
    for deployment in running:
        deployment.down()
    for what in ("container", "volume", "network"):
        names = engine.docker(
            what, "ls", "--quiet", *(["--all"] if what == "container" else []), "--filter", "name=davpc"
        )
        assert names == "", what


def cut_and_heal(deployment: Deployment) -> None:
    """Take the Leader off the robots' network during the approach, until the Follower has noticed."""
    network, gateway = f"{deployment.project}_robots", deployment.container("leader-gateway")
    deployment.wait_for("approach")
    heard = deployment.output().count("leader-gateway is reachable")
    lost = deployment.output().count("leader-gateway is not reachable")
    deployment.engine.docker("network", "disconnect", network, gateway)
    deployment.wait_for("leader-gateway is not reachable", lost + 1)
    deployment.engine.docker("network", "connect", "--alias", "leader", network, gateway)
    deployment.wait_for("leader-gateway is reachable", heard + 1)


@pytest.mark.alone
@pytest.mark.timeout(1800)
@pytest.mark.stepped_twin("tests/stepped/test_link.py::test_a_link_that_returns_in_the_approach_costs_nothing")
def test_it_docks_although_the_robots_network_is_cut_in_the_approach(start: Start) -> None:
    def attempt() -> None:
        deployment = start()
        cut_and_heal(deployment)
        code = deployment.finish()
        assert code == 0, deployment.output()[-6000:]
        results = deployment.results()
        assert is_docked(results), results
        for service in SERVICES:
            user = deployment.engine.docker("inspect", "--format", "{{.Config.User}}", deployment.container(service))
            assert user.strip() == "1000:1000"

    judged_on_a_calm_host(attempt)


@pytest.mark.alone
@pytest.mark.timeout(900)
def test_a_killed_container_ends_the_docking_by_name(start: Start) -> None:
    deployment = start()
    deployment.wait_for("approach")
    deployment.engine.docker("kill", deployment.container("follower-estimator"))
    assert deployment.finish() != 0
    if (deployment.out / "results.json").exists():
        assert not deployment.results()["connected"]
