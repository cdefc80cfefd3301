"""Two pairs side by side on one site: each through gateways of its own, and both through the site's router."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from common.bus import OnRequest
from common.channels import LEADER_STATE, LOCK_REQUEST
from tests.net.gateways import READY_S, Gateways, Recorder, authority, free_port, needs_openssl, published_until
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.waiting import until

pytestmark = [pytest.mark.alone, needs_openssl]
NAMES = ("a", "b")


def answering(name: bytes) -> OnRequest:
    """Answers with who answers."""
    return lambda _asked, answer: answer(name)


def written(pair: Gateways, path: Path) -> Path:
    """The pair's robots.toml: the reference with its network."""
    before, _, after = CONFIG_PATH.read_text().partition("[network]")
    settings = dict(setting.removeprefix("network.").split("=", 1) for setting in pair.settings)
    lines = "\n".join(f"{key} = {value}" for key, value in settings.items())
    path.write_text(f"{before}[network]\n{lines}\n[world]{after.partition('[world]')[2]}")
    return path


@pytest.fixture(scope="module", params=["gateways", "site router"])
def pairs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Gateways]]:
    """Two linked pairs, directly or through the site's router."""
    folder = tmp_path_factory.mktemp("site")
    robots = [f"{name}-{robot}" for name in NAMES for robot in ("follower", "leader")]
    certificates = authority(folder / "pki", "site", *robots)
    site = f"quic/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        made = {}
        for name in NAMES:
            settings = [f'network.{robot}.certificate="{name}-{robot}"' for robot in ("follower", "leader")]
            if request.param == "site router":
                settings += ['network.site_router="site"']
                settings += [f'network.{robot}.connect=["{site}"]' for robot in ("follower", "leader")]
            made[name] = Gateways(certificates, f"hall/{name}", *settings)
            stack.callback(made[name].close)
        if request.param == "site router":
            files = [str(written(pair, folder / f"{name}.toml")) for name, pair in made.items()]
            command = [sys.executable, "-m", "station.cli", "network", "site", *files, "--listen", site]
            command += ["--credentials", str(certificates)]
            router = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            stack.callback(router.terminate)
            assert router.stdout is not None
            assert b"routing for 2 pairs" in router.stdout.readline()
        yield {name: pair.linked() for name, pair in made.items()}


def test_each_pair_hears_itself_alone(pairs: dict[str, Gateways]) -> None:
    followers = {name: pair.play("follower-supervisor") for name, pair in pairs.items()}
    leaders = {name: pair.play("leader") for name, pair in pairs.items()}
    heard = {name: Recorder(bus, LEADER_STATE) for name, bus in followers.items()}
    for name, leader in leaders.items():
        leader.serve(LOCK_REQUEST, answering(name.encode()))
        leader.declare_alive("leader")

    def publish() -> None:
        for name, leader in leaders.items():
            leader.publish(LEADER_STATE, name.encode())

    published_until(publish, lambda: all(len(log.of(LEADER_STATE)) > 20 for log in heard.values()))
    for name, follower in followers.items():
        assert set(heard[name].of(LEADER_STATE)) == {name.encode()}
        until(lambda follower=follower, name=name: follower.request(LOCK_REQUEST, b"", 1.0) == name.encode(), READY_S)
        until(lambda follower=follower: "leader" in follower.alive(), READY_S)
