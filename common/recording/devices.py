"""Devices of a node, as the journal sees them: what each call returned or raised."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, Protocol, get_type_hints

import msgpack
from pydantic import TypeAdapter

from common.errors import ConfigError

# how a result stands in the journal: as a value of the method's return type, as an error, as pixels kept elsewhere
VALUE, ERROR, PIXELS = 0, 1, 2


class CallWatch(Protocol):
    """What device calls report to."""

    def inside(self, entered: bool) -> None:
        """A call of a device begins or ends: what it reads of the clock in between is its own."""

    def called(self, name: str, kind: Any, result: Any) -> None:
        """``device.method`` returned or raised ``result``; ``kind`` is its type."""


class DeviceProxy:
    """Passes everything on to a device and reports what comes back; calls that return nothing are not reported.

    Args:
        name: of the device, unique within its node.
        device: an object whose methods have annotated return types.
        watch: to report to.
    """

    def __init__(self, name: str, device: Any, watch: CallWatch) -> None:
        self.__dict__.update(_name=name, _device=device, _watch=watch)

    def __getattr__(self, attribute: str) -> Any:
        name = f"{self._name}.{attribute}"
        value = getattr(self._device, attribute)
        if not callable(value):
            self._watch.called(name, type(value), value)
            return value
        wrapped = _reporting(name, value, return_type(value), self._watch)
        self.__dict__[attribute] = wrapped  # the next call does not come here
        return wrapped


def _reporting(name: str, method: Callable[..., Any], kind: Any, watch: CallWatch) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        watch.inside(True)
        try:
            result = method(*args, **kwargs)
        except Exception as error:
            watch.called(name, None, error)
            raise
        finally:
            watch.inside(False)
        if kind is not None:
            watch.called(name, kind, result)
        return result

    return call


def return_type(method: Callable[..., Any]) -> Any:
    """The annotated type of a method's result; None where it returns nothing."""
    kind = get_type_hints(method).get("return", Any)
    return None if kind is type(None) else kind


@cache
def adapter(kind: Any) -> TypeAdapter[Any] | None:
    """What packs and checks a result of this type; None for pixels, which a journal does not keep."""
    return None if "ndarray" in str(kind) else TypeAdapter(kind)


def packed_result(kind: Any, result: Any) -> tuple[int, Any]:
    """How a result stands in the journal, and its packed form."""
    if isinstance(result, Exception):
        return ERROR, (type(result).__module__, type(result).__qualname__, str(result))
    packer = adapter(kind)
    if packer is None:
        return PIXELS, result is not None
    return VALUE, msgpack.packb(packer.dump_python(result, mode="json"))


def unpacked_error(packed: Any) -> Exception:
    """The exception that a device raised; only those of this repository come back as themselves."""
    match packed:
        case [str(module), str(name), str(text)]:
            kind = getattr(import_module(module), name, None) if module.startswith("common.") else None
            if isinstance(kind, type) and issubclass(kind, Exception):
                return kind(text)
            return RuntimeError(f"{name}: {text}")
    raise ConfigError("the journal holds an error in a form that this version does not have")
