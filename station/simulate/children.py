"""The processes of one simulated run: started together, stopped in order, nothing left of them."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from common.errors import ConfigError
from common.executor import EXIT_CONFIG
from common.processes import ONE_MACHINE, process
from common.timing import NS_PER_S, Clock

_TERMINATE_S = 3.0
_GONE_AFTER = 3
_PR_SET_PDEATHSIG = 1
_PREFIX, _NEW_PREFIX = "davpc-sim-", "davpc-new-"
_OWNER = "owner.lock"

Children = dict[str, subprocess.Popen[bytes]]


def start_children(
    children: Children, config_path: Path, overrides: Sequence[str], runtime: Path, logs: Path, keep_open: int
) -> None:
    """Start every process of the table and enter it into ``children`` at once, so that it can be stopped.

    Args:
        children: where they are entered.
        config_path: configuration file.
        overrides: of it, as ``table.key=value``.
        runtime: folder of their sockets and frames.
        logs: folder of their logs.
        keep_open: file descriptor that they inherit.
    """
    for entry in ONE_MACHINE:
        command = [sys.executable, "-m", "station.cli", "run", entry.name]
        command += ["--config", str(config_path.resolve()), "--runtime", str(runtime)]
        for override in overrides:
            command += ["--set", override]
        with (logs / f"{entry.name}.log").open("wb") as log:
            children[entry.name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                pass_fds=(keep_open,),
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                preexec_fn=_die_with_parent,
            )


def stop_children(children: Children) -> None:
    """SIGTERM to both robots, so that their drives stop in order, then to the world; SIGKILL to what is left."""
    robots = [child for name, child in children.items() if process(name).robot != "world"]
    world = [child for name, child in children.items() if process(name).robot == "world"]
    for group in (robots, world):
        for child in group:
            if child.poll() is None:
                child.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _TERMINATE_S
        for child in group:
            try:
                child.wait(timeout=max(0.05, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def resident_mb(pid: int) -> float | None:
    """Resident memory of a process that lives [MB]."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _die_with_parent() -> None:
    """In the child: end it if the launcher is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@contextlib.contextmanager
def runtime_directory() -> Iterator[Path]:
    """A private directory for sockets and frames, in memory where there is any; gone at the end."""
    parent = next((path for path in ("/dev/shm", "/run/shm") if os.access(path, os.W_OK)), None)
    _remove_orphans(Path(parent or tempfile.gettempdir()))
    made = Path(tempfile.mkdtemp(prefix=_NEW_PREFIX, dir=parent))
    with (made / _OWNER).open("w") as owner:
        fcntl.flock(owner, fcntl.LOCK_EX)
        # only now may another run take it for an orphan, and find it owned
        path = made.rename(made.with_name(made.name.replace(_NEW_PREFIX, _PREFIX)))
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


def _remove_orphans(parent: Path) -> None:
    """Directories of launchers that were killed before they could clean up."""
    for path in parent.glob(f"{_PREFIX}*/{_OWNER}"):
        with contextlib.suppress(OSError), path.open("r") as owner:
            fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(path.parent, ignore_errors=True)


@contextlib.contextmanager
def listening_socket() -> Iterator[socket.socket]:
    """The CAN server's socket: bound here, so that its port is known and taken."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def with_server(overrides: Sequence[str], server: socket.socket) -> list[str]:
    """The overrides that bring both buses to the CAN server on this socket."""
    host, port = server.getsockname()
    buses = [f'{bus}.bus.host="{host}"' for bus in ("follower_can", "leader_can")]
    buses += [f"{bus}.bus.port={port}" for bus in ("follower_can", "leader_can")]
    return [*overrides, *buses, f"world.can_server_fd={server.fileno()}"]


def death(children: Children, logs: Path) -> str:
    """Which child ended, and how; empty while all live."""
    for name, child in children.items():
        code = child.poll()
        if code is None:
            continue
        last_words = _last_words(logs / f"{name}.log")
        if code == EXIT_CONFIG:
            raise ConfigError(last_words)
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}: {last_words}"
        return f"process {name} died ({how})"
    return ""


def _last_words(path: Path) -> str:
    """What the process logged as its last error."""
    log = path.read_text(encoding="utf-8", errors="replace")
    errors = [line.partition(" ERROR ")[2] for line in log.split("\n") if " ERROR " in line]
    return errors[-1] if errors else f"see {path.parent.name}/{path.name}"


class Absence:
    """Notices that a process that another launcher started was alive and is no more; looks once a second.

    On a busy machine a link may break for a moment, and its process seem dead: three looks in a row count.

    Args:
        alive: names of the processes that are alive now.
        names: those to look for.
        clock: of this machine.
    """

    def __init__(self, alive: Callable[[], set[str]], names: set[str], clock: Clock) -> None:
        self._ask_alive, self._names, self._clock = alive, names, clock
        self._seen: set[str] = set()
        self._missed: Counter[str] = Counter()
        self._due_ns = 0

    def __call__(self) -> str:
        """Which one, or nothing."""
        now_ns = self._clock.now_ns()
        if now_ns < self._due_ns:
            return ""
        self._due_ns = now_ns + NS_PER_S
        alive = self._ask_alive()
        missing = (self._seen & self._names) - alive
        self._missed = Counter({name: self._missed[name] + 1 for name in missing})
        self._seen |= alive
        gone = sorted(name for name, times in self._missed.items() if times >= _GONE_AFTER)
        return f"process {gone[0]} died (no longer alive)" if gone else ""
