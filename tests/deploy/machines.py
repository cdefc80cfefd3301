"""Machines that boot a real systemd: systemd-nspawn on an overlay of this machine's own root, no download."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

# what takes longer hangs, also on a busy machine with two cores; what has to be quick is measured and asserted
PATIENCE_S = 90.0
_TOOLS = {
    "systemd-nspawn": "systemd-container",
    "nsenter": "util-linux",
    "ip": "iproute2",
    "udevadm": "udev",
    "openssl": "openssl",
}
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
# of several hierarchies systemd's own; of a single one its root
_CGROUPS = [path for path in map(Path, ("/sys/fs/cgroup/systemd", "/sys/fs/cgroup/unified")) if path.is_dir()] or [
    Path("/sys/fs/cgroup")
]


def why_not(folder: Path) -> str:
    """Why this machine cannot boot others; empty if it can, and their disks can lie in ``folder``, in memory.

    On a disk they would lie below what they are laid over, which an overlay refuses.
    """
    if os.geteuid() != 0:
        return "booting machines needs root"
    for tool, package in _TOOLS.items():
        if shutil.which(tool) is None:
            return f"{tool} is not installed (package {package})"
    trial = folder / "trial"
    attempts: dict[str, list[str | Path]] = {
        "no tmpfs can be mounted": ["mount", "-t", "tmpfs", "davpc", folder],
        "no folder can be made": ["mkdir", "-p", trial / "up", trial / "work", trial / "root"],
        "no overlay of / can be mounted": _overlay([Path("/")], trial),
        "an overlay stays mounted": ["umount", trial / "root"],
        "no network namespace can be made": ["ip", "netns", "add", trial_name := f"davpc-{os.getpid()}-trial"],
        "a network namespace stays": ["ip", "netns", "delete", trial_name],
        "no control group can be made": ["mkdir", *(path / trial_name for path in _CGROUPS)],
        "a control group stays": ["rmdir", *(path / trial_name for path in _CGROUPS)],
    }
    for reason, command in attempts.items():
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"{reason}: {done.stderr.strip()}"
    return ""


def until(condition: Callable[[], object], seconds: float, what: str) -> float:
    """Wait for a condition; the seconds that it took."""
    begin = time.monotonic()
    while not condition():
        if time.monotonic() - begin > seconds:
            pytest.fail(f"waited {seconds:.0f} s in vain: {what}")
        time.sleep(0.02)
    return time.monotonic() - begin


class Network:
    """A namespace for each machine, and cables between two of them. Leaves nothing behind."""

    def __init__(self, tag: str, machines: int) -> None:
        self.spaces = [f"davpc-{tag}-{number}" for number in range(machines)]
        for space in self.spaces:
            _ip("netns", "add", space)
            _ip("-n", space, "link", "set", "lo", "up")

    def cable(self, name: str, addresses: tuple[str, str]) -> None:
        """Join the first two machines; the interface has this name on both."""
        a, b = self.spaces[:2]
        _ip("link", "add", name, "netns", a, "type", "veth", "peer", "name", name, "netns", b)
        for space, address in zip((a, b), addresses, strict=True):
            _ip("-n", space, "address", "add", f"{address}/24", "dev", name)
        self.plug(name, True)

    def plug(self, name: str, on: bool) -> None:
        """Connect or cut a cable."""
        for space in self.spaces:
            _ip("-n", space, "link", "set", name, "up" if on else "down")

    def close(self) -> None:
        """Take the namespaces away, with what is in them."""
        for space in self.spaces:
            _ip("netns", "delete", space)


class Machine:
    """One machine.

    Args:
        name: its host name, and of its control group.
        folder: where its disk lies.
        layers: read-only disks under its own, the topmost first.
        space: network namespace.
        shared: folders that it sees, read-only, by their place in it.
    """

    def __init__(
        self, name: str, folder: Path, layers: Sequence[Path], space: str, shared: Mapping[str, Path]
    ) -> None:
        self.name, self.folder, self._space, self._shared = name, folder, space, dict(shared)
        self.root = folder / "root"
        self._cgroups = [path / f"davpc-{os.getpid()}-{name}" for path in _CGROUPS]
        self._nspawn: subprocess.Popen[bytes] | None = None
        self.pid = 0
        for part in ("up", "work", "root"):
            (folder / part).mkdir(parents=True)
        subprocess.run(_overlay([*layers, Path("/")], folder), check=True)
        (self.root / "etc/machine-id").write_text(f"{os.urandom(16).hex()}\n")
        (self.root / "etc/hostname").write_text(f"{name}\n")
        for wants in (self.root / "etc/systemd/system").glob("*.wants"):
            if not layers:  # what this machine runs is none of theirs
                shutil.rmtree(wants)

    @property
    def disk(self) -> Path:
        """What this machine has written; a layer for others once it is off."""
        return self.folder / "up"

    def boot(self) -> None:
        """Switch on, and return when services may be started."""
        command = ["systemd-nspawn", "-q", "--register=no", "--keep-unit", "-M", self.name, "-D", str(self.root)]
        command += [f"--network-namespace-path=/run/netns/{self._space}"]
        command += [f"--bind-ro={outside}:{inside}" for inside, outside in self._shared.items()]
        command += [
            "--capability=CAP_IPC_LOCK,CAP_NET_ADMIN",
            "--system-call-filter=@memlock",
            "--boot",
            "--console=pipe",
        ]
        command += ["systemd.unit=multi-user.target"]
        with (self.folder / "console.log").open("ab") as console:
            self._nspawn = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                preexec_fn=self._enter_cgroup,
                start_new_session=True,
            )
        until(self._find_init, PATIENCE_S, f"{self.name} to start: see {self.folder}/console.log")
        until(lambda: self.is_active("basic.target"), PATIENCE_S, f"{self.name} to boot")

    def call(self, *command: str, seconds: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
        """Run a command inside."""
        enter = ["nsenter", "-t", str(self.pid), "-a", "env", "-i", f"PATH={_PATH}", "LC_ALL=C.UTF-8"]
        return subprocess.run(
            [*enter, *command], capture_output=True, text=True, check=False, timeout=seconds, stdin=subprocess.DEVNULL
        )

    def must(self, *command: str, seconds: float = PATIENCE_S) -> str:
        """Run a command that has to succeed; its output."""
        done = self.call(*command, seconds=seconds)
        assert done.returncode == 0, f"{self.name}: {' '.join(command)}\n{done.stdout}{done.stderr}"
        return done.stdout + done.stderr

    def show(self, unit: str, key: str) -> str:
        """A property of a unit."""
        return self.call("systemctl", "show", "-P", key, unit).stdout.strip()

    def is_active(self, unit: str) -> bool:
        """Whether a unit runs."""
        return self.show(unit, "ActiveState") == "active"

    def journal(self, *arguments: str) -> str:
        """What was logged since it booted."""
        return self.call("journalctl", "-q", "-b", "-o", "cat", "--no-pager", *arguments).stdout

    def cut_power(self) -> None:
        """Everything on it ends at once."""
        assert self._nspawn is not None
        for pid in [self.pid] if self.pid else self._everybody():
            os.kill(pid, signal.SIGKILL)
        self._nspawn.wait()
        self._nspawn, self.pid = None, 0

    def close(self) -> None:
        """Switch off and unmount."""
        if self._nspawn is not None:
            self.cut_power()
        subprocess.run(["umount", self.root], check=True)
        for cgroup in self._cgroups:
            for path in sorted(cgroup.rglob("*"), reverse=True):
                if path.is_dir():
                    path.rmdir()
            if cgroup.is_dir():
                cgroup.rmdir()

    def _everybody(self) -> list[int]:
        """All its processes, nspawn among them: for a machine that did not come so far as to have a first one."""
        lists = [path.read_text().split() for path in self._cgroups[0].rglob("cgroup.procs")]
        return [int(pid) for pids in lists for pid in pids]

    def _enter_cgroup(self) -> None:
        for cgroup in self._cgroups:
            cgroup.mkdir(exist_ok=True)
            (cgroup / "cgroup.procs").write_text(str(os.getpid()))

    def _find_init(self) -> bool:
        assert self._nspawn is not None
        assert self._nspawn.poll() is None, (self.folder / "console.log").read_text()
        for child in Path(f"/proc/{self._nspawn.pid}/task/{self._nspawn.pid}/children").read_text().split():
            try:
                status = Path(f"/proc/{child}/status").read_text()
            except OSError:  # it has ended meanwhile
                continue
            # nspawn's own children come first; the machine's is number 1 in there and no longer nspawn
            if re.search(r"^NSpid:.*\t1$", status, re.MULTILINE) and "Name:\tsystemd-nspawn" not in status:
                self.pid = int(child)
                return True
        return False


def _overlay(lower: Sequence[Path], folder: Path) -> list[str | Path]:
    """The command that mounts it."""
    options = f"lowerdir={':'.join(map(str, lower))},upperdir={folder / 'up'},workdir={folder / 'work'}"
    return ["mount", "-t", "overlay", "overlay", "-o", options, folder / "root"]


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
