"""A node's state before a step, so that a replay may begin in the middle of a run.

Devices and clock stay outside; everything else is pickled by value. A file may come from a stranger: unpickling makes
objects of this repository's algorithms and of numpy only, and calls nothing else.
"""

from __future__ import annotations

import io
import pickle
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import msgpack

from common.messages import NodeSnapshot
from common.messages.records import MOST_RECORD_BYTES
from common.node import Inbox, Node
from common.recording.devices import DeviceProxy
from common.recording.journal import JournaledClock

_MOST_BYTES = 32_000_000
_OURS = ("common", "follower", "leader")
# what opens files, sockets or devices when it is made
_CLOSED = (
    "common.bus",
    "common.executor",
    "common.files",
    "common.frames",
    "common.canopen.bus",
    "common.canopen.node",
)
_PLAIN = {
    ("builtins", name)
    for name in ("set", "frozenset", "complex", "bytearray", "slice", "range", "object", "dict", "list", "tuple")
} | {
    ("collections", "deque"),
    ("collections", "OrderedDict"),
    ("collections", "Counter"),
    ("collections", "defaultdict"),
    ("datetime", "date"),
    ("datetime", "datetime"),
    ("datetime", "timedelta"),
    ("pathlib", "PosixPath"),
    ("pathlib", "PurePosixPath"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("functools", "partial"),
}


class SnapshotError(ValueError):
    """State that cannot be restored; one line that says why."""


def take(node: Node, inbox: Inbox, step: int) -> list[NodeSnapshot]:
    """The state of a node and its inbox before step number ``step``, as messages."""
    stream = io.BytesIO()
    _Pickler(stream, protocol=5).dump(dict(vars(node)))
    newest, late = inbox.kept()
    packed = zlib.compress(msgpack.packb((stream.getvalue(), newest, late)), 1)
    cuts = range(0, len(packed), MOST_RECORD_BYTES)
    return [
        NodeSnapshot(step, part, len(cuts), packed[begin : begin + MOST_RECORD_BYTES])
        for part, begin in enumerate(cuts)
    ]


def restore(parts: Sequence[NodeSnapshot], node: Node, inbox: Inbox, outside: Mapping[str, Any]) -> None:
    """Put a node, newly made, and its inbox into the state of a snapshot.

    Args:
        parts: all of one snapshot, in order.
        node: of the same process.
        inbox: new.
        outside: what takes the place of devices, by name, and of the ``clock``.

    Raises:
        SnapshotError: parts are missing, or they hold what no snapshot holds.
    """
    if [each.part for each in parts] != list(range(parts[0].parts if parts else 1)):
        raise SnapshotError("a part of the snapshot is missing")
    try:
        unzip = zlib.decompressobj()
        packed = unzip.decompress(b"".join(each.state for each in parts), _MOST_BYTES)
        pickled, newest, late = msgpack.unpackb(packed)
        state = _Unpickler(io.BytesIO(pickled), outside).load()
        inbox.put_back(newest, late)
        vars(node).update(state)
    except SnapshotError:
        raise
    except Exception as error:  # a pickle may raise anything
        raise SnapshotError(f"not a snapshot of this version: {type(error).__name__}: {error}") from error


class _Pickler(pickle.Pickler):
    def persistent_id(self, obj: Any) -> str | None:
        if isinstance(obj, DeviceProxy):
            return str(vars(obj)["_name"])
        return "clock" if isinstance(obj, JournaledClock) else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, outside: Mapping[str, Any]) -> None:
        super().__init__(stream)
        self._outside = outside

    def persistent_load(self, pid: Any) -> Any:
        if pid not in self._outside:
            raise SnapshotError(f"no device {pid!r} in this version")
        return self._outside[pid]

    def find_class(self, module: str, name: str) -> Any:
        ours = module.partition(".")[0] in _OURS and not module.startswith(_CLOSED) and "." not in name
        if not ours and (module, name) not in _PLAIN:
            raise SnapshotError(f"it names {module}.{name}, which no node's state holds")
        found = super().find_class(module, name)
        if ours and not isinstance(found, type):
            raise SnapshotError(f"it names {module}.{name}, which is no type")
        return found
