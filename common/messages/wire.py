"""Messages as MessagePack on the wire: header, body, checksum."""

from __future__ import annotations

import zlib
from functools import cache
from typing import Annotated, Any, ClassVar, Protocol, TypeVar

import msgpack
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from common.files.parsing import one_line
from common.messages.fields import STRICT, Count, Ns


class MessageError(ValueError):
    """Bytes that are not a valid message of the expected type; the text, one line of bounded length, names the fault.

    It may quote what a stranger sent: what is not printable is replaced.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(one_line(reason))


class Message(Protocol):
    """Every message has a schema: name and version."""

    SCHEMA: ClassVar[str]


@dataclass(frozen=True, config=STRICT)
class Header:
    """Who published the message, when, and its number on the channel.

    ``run_id`` changes with every start of the process; ``stamp_ns`` is CLOCK_MONOTONIC of boot ``boot_id``.
    """

    source: Annotated[str, Field(max_length=64)]
    run_id: Count
    sequence: Count
    stamp_ns: Ns
    boot_id: Annotated[str, Field(max_length=64)]


M = TypeVar("M", bound=Message)
_MAX_BYTES = 65_536
_PAIR, _QUADRUPLE = b"\x92", b"\x94"  # MessagePack's heads of an array of two and of four


@cache
def _adapter(message_type: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(message_type)


def encode(message: Message, header: Header) -> bytes:
    """MessagePack bytes of a message and its header."""
    fields = _adapter(Header).dump_python(header)
    body = _adapter(type(message)).dump_python(message)
    content: bytes = msgpack.packb(fields) + msgpack.packb(body)
    checksum = zlib.crc32(_PAIR + content)
    packed: bytes = _QUADRUPLE + msgpack.packb(message.SCHEMA) + content + msgpack.packb(checksum)
    return packed


def decode(message_type: type[M], payload: bytes) -> tuple[Header, M]:
    """Header and message of MessagePack bytes.

    Raises:
        MessageError: other schema or version, wrong type, missing or unknown field, out of range, not finite,
            or a wrong checksum.
    """
    if len(payload) > _MAX_BYTES:
        raise MessageError(f"{len(payload)} bytes are more than a message may have")
    try:
        unpacked = msgpack.unpackb(payload, use_list=False)
    except (ValueError, RecursionError, msgpack.UnpackException) as error:
        raise MessageError(f"not MessagePack: {type(error).__name__}") from error
    if not isinstance(unpacked, tuple) or len(unpacked) != 4:
        raise MessageError("not [schema, header, body, checksum]")
    schema, fields, body, checksum = unpacked
    if schema != message_type.SCHEMA:
        raise MessageError(f"schema {schema!r}, expected {message_type.SCHEMA!r}")
    try:
        header, message = Header(**fields), message_type(**body)
    except TypeError as error:
        raise MessageError(f"{schema}: header or body is not a table") from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise MessageError(f"{schema}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    if checksum != _crc(body, fields):
        raise MessageError(f"{schema}: checksum does not fit")
    return header, message


def _crc(body: dict[str, Any], header: dict[str, Any]) -> int:
    """CRC-32 of header and body in their packed form."""
    return zlib.crc32(msgpack.packb([header, body]))
