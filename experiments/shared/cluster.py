"""Runs on a dask.distributed cluster: ``--cluster tcp://HOST:8786``; see docs/cluster.md.

A thread of a dask worker hands each run to a process of its own: a worker has threads, and a run may fork.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import platform
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from importlib import metadata
from pathlib import Path

import common
from common.config import default_config_path
from common.errors import ConfigError, DeviceError
from experiments.shared.worker import Children

CONNECT_S, WORKERS_S = 10.0, 30.0
_SOURCES = ("common", "follower", "gateway", "leader", "sim", "station", "experiments")
_LIBRARIES = ("numpy", "opencv-python-headless", "casadi", "daqp")


@contextlib.contextmanager
def cluster_submits(address: str) -> Iterator[Callable[[bytes], Future[bytes]]]:
    """A function that hands a pickled run to the cluster, whose scheduler repeats what a lost worker was doing.

    Raises:
        ConfigError: dask.distributed is not installed, no scheduler answers, no worker is there, or a worker has
            other software.
        DeviceError: the scheduler was lost, or a run lost its workers more often than the scheduler allows.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ModuleNotFoundError as error:
        raise ConfigError(f"--cluster needs {error.name}: pip install 'davpc[cluster]'") from error
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there: {_first_line(error)}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except (OSError, TimeoutError) as error:
            raise ConfigError(f"--cluster {address}: no worker in {WORKERS_S:.0f} s") from error
        executor = client.get_executor(pure=False)
        expected = software()
        try:
            yield lambda request: executor.submit(do_here, request, expected)
        except distributed.KilledWorker as error:
            raise DeviceError(
                f"--cluster {address}: a run lost its worker too often: {_first_line(error)}"
            ) from error
        except CancelledError as error:
            raise DeviceError(f"--cluster {address}: the scheduler was lost") from error
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"--cluster {address}: a worker lacks the module {error.name}: see docs/cluster.md"
            ) from error
        finally:
            executor.shutdown(wait=False)


def do_here(request: bytes, expected: str) -> bytes:
    """On a worker: one run, if this machine has the software of the caller.

    Raises:
        ConfigError: it has another: the results would not be the same.
    """
    here = software()
    if here != expected:
        raise ConfigError(f"worker {socket.gethostname()} has other software: {here}; the caller has {expected}")
    return _children().do(request)


@functools.cache
def software() -> str:
    """What a result depends on beside its run: a digest of the code and its files, versions of what computes."""
    digest = hashlib.sha256()
    root = Path(common.__file__).parents[1]
    files = [path for name in _SOURCES for path in (root / name).rglob("*.py")]
    for path in sorted(files, key=lambda each: each.relative_to(root).as_posix()):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    for path in sorted(default_config_path().parent.iterdir()):
        if path.is_file():
            digest.update(f"{path.name}\0".encode() + path.read_bytes())
    versions = [f"{name} {metadata.version(name)}" for name in _LIBRARIES]
    return ", ".join([f"davpc {digest.hexdigest()[:12]}", f"Python {platform.python_version()}", *versions])


@functools.cache
def _children() -> Children:
    """Those of this worker: as many as it has threads; they end with it."""
    return Children()


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).partition("\n")[0]
