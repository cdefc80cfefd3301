"""A container engine of the tests' own, and the image, from a base made on the spot."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

import pytest

from tests.rigs.waiting import until

ROOT = Path(__file__).parents[2]
# Debian's own: another docker that comes first on the path may lack what these need
TOOLS = {name: f"/usr/bin/{name}" for name in ("docker", "docker-compose", "mmdebstrap")}
DAEMON = "/usr/sbin/dockerd"
PACKAGES = "docker.io docker-compose iptables mmdebstrap"
IMAGE, BASE = "davpc-test", "davpc-test-base"
# a tar file of the base and wheels outlive a run here, where the tests are repeated; a fresh checkout has none
CACHE = ROOT / "out/docker-test"


def missing() -> str:
    """Why no container can run here; empty if one can."""
    absent = [path for path in (*TOOLS.values(), DAEMON) if not os.access(path, os.X_OK)]
    if absent:
        return f"no container engine: {', '.join(absent)} missing; as root: apt-get install {PACKAGES}"
    return "" if os.geteuid() == 0 else "a container engine of one's own needs root"


class Group:
    """Control group of all containers, with a weight that keeps them going beside whatever else the machine does.

    A container gets no real-time scheduling; late loops stop a robot, and rightly so.
    """

    def __init__(self, name: str) -> None:
        root = Path("/sys/fs/cgroup")
        old = (root / "cpu").is_dir()
        self._folders = [path / name for path in root.iterdir() if path.is_dir()] if old else [root / name]
        cpu = root / "cpu" / name if old else root / name
        cpu.mkdir()
        weight, most = ("cpu.shares", 262_144) if old else ("cpu.weight", 10_000)
        if (cpu / weight).exists():
            (cpu / weight).write_text(str(most))

    def remove(self) -> None:
        """Remove it under every controller."""
        for folder in self._folders:
            if folder.is_dir():
                until(partial(_removed, folder), 20)


def _removed(folder: Path) -> bool:
    try:
        folder.rmdir()
    except OSError:
        return False
    return True


class Engine:
    """dockerd with everything of its in one folder; it leaves the host's firewall and routing alone."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._group = Group(folder.name)
        self._log = (folder / "dockerd.log").open("wb")
        command = [DAEMON, "--data-root", str(folder / "root"), "--exec-root", str(folder / "exec")]
        command += ["--pidfile", str(folder / "pid"), "--host", f"unix://{folder}/sock", "--bridge", "none"]
        command += [
            "--cgroup-parent",
            f"/{folder.name}",
            "--iptables=false",
            "--ip6tables=false",
            "--ip-masq=false",
            "--ip-forward=false",
        ]
        self._daemon = subprocess.Popen(command, stdout=self._log, stderr=self._log)
        self.environment = {**os.environ, "DOCKER_HOST": f"unix://{folder}/sock", "DOCKER_BUILDKIT": "0"}
        until(lambda: self._daemon.poll() is not None or self.answers(), 60)
        assert self.answers(), (folder / "dockerd.log").read_text()

    def answers(self) -> bool:
        """Whether it takes commands."""
        return subprocess.run([TOOLS["docker"], "version"], env=self.environment, capture_output=True).returncode == 0

    def docker(self, *arguments: str) -> str:
        """Run the docker command; its output."""
        command = [TOOLS["docker"], *arguments]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"docker {' '.join(arguments)}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout

    def stop(self) -> None:
        """End it, and whatever it still runs."""
        self._daemon.terminate()
        self._daemon.wait(timeout=60)
        self._log.close()
        self._group.remove()


def base_tar() -> Path:
    """A small Debian with Python, made from the distribution's packages."""
    made = CACHE / "base.tar"
    if not made.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        release = dict(line.split("=", 1) for line in Path("/etc/os-release").read_text().splitlines() if "=" in line)
        command = [TOOLS["mmdebstrap"], "--quiet", "--variant=minbase"]
        command += ["--include=python3,python3-venv,ca-certificates,openssl", release["VERSION_CODENAME"]]
        subprocess.run([*command, str(made.with_suffix(".part.tar"))], check=True)
        made.with_suffix(".part.tar").rename(made)
    return made


def context(folder: Path) -> Path:
    """What the image is built from: the tracked files, and the locked packages as pip fetches them."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True
    )
    names = listed.stdout.splitlines() or pytest.fail("not a checkout: the image is built from tracked files")
    for name in names:
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    wheels = next((path for path in (ROOT / "out/wheels", CACHE / "wheels") if path.is_dir()), None)
    if wheels is None:
        wheels = CACHE / "wheels"
        subprocess.run([ROOT / "deploy/install.sh", "wheels", wheels], check=True)
    shutil.copytree(wheels, folder / "docker/wheels", dirs_exist_ok=True)
    return folder


class Deployment:
    """One ``docker compose up`` of the shipped file, under a project name of its own."""

    def __init__(self, engine: Engine, project: str, out: Path) -> None:
        self.engine, self.project, self.out = engine, project, out
        out.mkdir()
        os.chown(out, 1000, 1000)
        self._output = out.with_suffix(".log")
        command = [*self.compose(), "up", "--no-build", "--no-color", "--exit-code-from", "station"]
        with self._output.open("wb") as log:
            self._up = subprocess.Popen(command, env=self.environment(), stdout=log, stderr=log)

    def compose(self) -> list[str]:
        """The command for this project."""
        return [TOOLS["docker-compose"], "-p", self.project, "-f", str(ROOT / "docker/compose.yaml")]

    def environment(self) -> dict[str, str]:
        """What the compose file is filled in with."""
        chosen = {"DAVPC_IMAGE": IMAGE, "DAVPC_OUT": str(self.out), "DAVPC_START": "[2.4,0.08,2.0]"}
        return {**self.engine.environment, **chosen}

    def container(self, service: str) -> str:
        """Name of a service's container."""
        return f"{self.project}_{service}_1"

    def output(self) -> str:
        """What all services said."""
        return self._output.read_text(errors="replace")

    def wait_for(self, text: str, times: int = 1) -> None:
        """Until a line holds the text."""
        until(lambda: self.output().count(text) >= times or self._up.poll() is not None, 240)
        assert self.output().count(text) >= times, self.output()[-6000:]

    def finish(self) -> int:
        """Wait for the end; the exit code."""
        return self._up.wait(timeout=300)

    def results(self) -> dict[str, object]:
        """What the docking left in the mounted folder."""
        content: dict[str, object] = json.loads((self.out / "results.json").read_text())
        return content

    def down(self) -> None:
        """Take it away."""
        if self._up.poll() is None:
            self._up.terminate()
            self._up.wait(timeout=120)
        command = [*self.compose(), "down", "--volumes"]
        done = subprocess.run(command, env=self.environment(), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
