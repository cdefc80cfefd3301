"""A pair of gateways on loopback, each with processes of its robot that these tests play."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from common.bus import Bus
from common.channels import Channel
from common.messages import Header, LeaderState, Message, encode
from common.processes import GATEWAYS, PROCESSES
from gateway.access import OTHER, Robot
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.waiting import until

PKI = Path(__file__).parents[2] / "deploy/pki.sh"
READY_S = 90.0
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def pki(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``deploy/pki.sh`` on a folder."""
    return subprocess.run([str(PKI), "--dir", str(folder), *arguments], capture_output=True, text=True, check=False)


def authority(folder: Path, *names: str) -> Path:
    """A new authority with certificates for loopback."""
    for command in (["ca"], *(["issue", name, "--host", "127.0.0.1"] for name in names)):
        done = pki(folder, *command)
        assert done.returncode == 0, done.stderr
    return folder


def free_port() -> int:
    """A free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        return int(link.getsockname()[1])


def packed(message: Message, sequence: int = 1, source: str = "leader") -> bytes:
    """A message as some process publishes it."""
    return encode(message, Header(source, 1, sequence, 1, "boot"))


def leader_state(queue: int = 0) -> LeaderState:
    """A Leader's heartbeat that ``queue`` tells from others."""
    return LeaderState(True, "", (1.0,), False, "down", "open", 0.0, queue)


class Gateways:
    """A pair: its runtime directories, gateway processes, and what is configured alike for both."""

    def __init__(self, pki_folder: Path, namespace: str = "davpc", *settings: str) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="davpc-net-"))
        self.ports: dict[Robot, int] = {robot: free_port() for robot in OTHER}
        self.namespace = namespace
        self.pki = pki_folder
        self.settings = [
            f'network.credentials="{pki_folder}"',
            f'network.namespace="{namespace}"',
            *(
                f'network.{robot}.{way}=["quic/127.0.0.1:{port}"]'
                for robot, port in self.ports.items()
                for way, port in (("listen", port), ("connect", self.ports[OTHER[robot]]))
            ),
            'network.operators=["operator"]',
            *settings,
        ]
        self.running: dict[Robot, subprocess.Popen[bytes]] = {}
        self._stack = ExitStack()
        for robot in OTHER:
            (self.folder / robot).mkdir(mode=0o700)

    def runtime(self, robot: Robot) -> Path:
        """The robot's private directory."""
        return self.folder / robot

    def log(self, robot: Robot) -> str:
        """What its gateway logged."""
        return (self.folder / f"{robot}.log").read_text(errors="replace")

    def start(self, robot: Robot) -> None:
        """Start a robot's gateway."""
        self.running[robot] = self.spawned(GATEWAYS[robot], robot, self.folder / f"{robot}.log")

    def spawned(self, name: str, robot: Robot, path: Path) -> subprocess.Popen[bytes]:
        """A process of the table, run in a robot's mesh, with the file that it logs to."""
        command = [sys.executable, "-m", "station.cli", "run", name, "--config", str(CONFIG_PATH)]
        command += ["--runtime", str(self.runtime(robot)), *self.options()]
        with path.open("ab") as log:
            return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def options(self) -> list[str]:
        """The settings as options of the command line."""
        return [word for setting in self.settings for word in ("--set", setting)]

    def play(self, name: str) -> Bus:
        """A session under the name of a process, in its robot's mesh."""
        (robot,) = {entry.robot for entry in PROCESSES if entry.name == name}
        runtime = self.runtime("leader" if robot == "leader" else "follower")
        earlier = [entry.name for entry in PROCESSES if entry.robot == robot and entry.name < name]
        return self._stack.enter_context(Bus(name, runtime, earlier, self.namespace))

    def linked(self) -> Gateways:
        """Both gateways, once each hears the other."""
        for robot in OTHER:
            self.start(robot)
        until(lambda: all("is reachable" in self.log(robot) for robot in OTHER) or self.dead(), READY_S)
        assert not self.dead(), [self.log(robot) for robot in OTHER]
        return self

    def dead(self) -> bool:
        """Whether a gateway ended by itself."""
        return any(child.poll() is not None for child in self.running.values())

    def close(self) -> None:
        """End everything."""
        self._stack.close()
        for child in self.running.values():
            child.terminate()
        for child in self.running.values():
            child.wait(timeout=20)
        shutil.rmtree(self.folder)


class Recorder:
    """Records the payloads of some channels, by key."""

    def __init__(self, bus: Bus, *channels: Channel[Any]) -> None:
        self.payloads: dict[str, list[bytes]] = {channel.key: [] for channel in channels}
        for channel in channels:
            bus.stream(channel, self.payloads[channel.key].append)

    def of(self, channel: Channel[Any]) -> list[bytes]:
        """Payloads of one channel so far."""
        return self.payloads[channel.key]


def published_until(publish: Callable[[], None], received: Callable[[], object]) -> None:
    """Repeat a publication until it is received: sessions need a moment to find each other."""

    def attempt() -> bool:
        publish()
        return bool(received())

    until(attempt, READY_S)
