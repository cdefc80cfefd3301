"""Messages survive the wire, and nothing else does."""

from __future__ import annotations

import dataclasses
import math
import zlib
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.channels import CHANNELS, Channel
from common.messages import (
    Answer,
    Command,
    Header,
    LeaderState,
    MessageError,
    command_checksum,
    decode,
    encode,
    seal_command,
)

HEADER = Header("test", 7, 1, 123, "boot")
COMMAND = seal_command(Command(0.1, -0.2, 3, 4, 5, 6, 7, 8))
LEADER = LeaderState(True, "", (1.0, 1.0, 1.0, 1.0), False, "down", "open", 0.0, 0)


def repacked(payload: bytes, change: Any) -> bytes:
    """The payload with its parts changed and its outer checksum made to fit again."""
    schema, header, body, _ = msgpack.unpackb(payload)
    schema, header, body = change(schema, header, body)
    packed: bytes = msgpack.packb([schema, header, body, zlib.crc32(msgpack.packb([header, body]))])
    return packed


@pytest.mark.parametrize("message", [COMMAND, LEADER, Answer("a", "done", "")])
def test_messages_round_trip(message: Any) -> None:
    assert decode(type(message), encode(message, HEADER)) == (HEADER, message)


def values(annotation: Any) -> st.SearchStrategy[Any]:
    """Values that a message's field may have, drawn from its annotation."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        bounds = {type(m).__name__: m for info in arguments[1:] for m in info.metadata}
        low = bounds["Ge"].ge if "Ge" in bounds else bounds["Gt"].gt + 1e-6 if "Gt" in bounds else None
        high = bounds["Le"].le if "Le" in bounds else bounds["Lt"].lt - 1 if "Lt" in bounds else None
        if arguments[0] is float:
            return st.floats(low, high, allow_nan=False, allow_infinity=False)
        if arguments[0] is int:
            return st.integers(low, high)
        if arguments[0] is str:
            least = bounds["MinLen"].min_length if "MinLen" in bounds else 0
            return st.text(min_size=least, max_size=bounds["MaxLen"].max_length)
        size = bounds.get("MinLen")
        item = values(get_args(arguments[0])[0])
        return st.lists(item, min_size=size.min_length if size else 0, max_size=bounds["MaxLen"].max_length).map(
            tuple
        )
    if origin is tuple:
        return st.tuples(*map(values, arguments))
    if origin in (Union, UnionType):
        return st.one_of(*map(values, arguments))
    if annotation is float:
        return st.floats(allow_nan=False, allow_infinity=False)
    return st.from_type(annotation)


@given(st.data())
def test_any_valid_message_of_any_channel_round_trips(data: st.DataObject) -> None:
    channel: Channel[Any] = data.draw(st.sampled_from(CHANNELS))
    hints = get_type_hints(channel.message, include_extras=True)
    fields = {field.name: data.draw(values(hints[field.name])) for field in dataclasses.fields(channel.message)}
    message = channel.message(**fields)
    assert decode(channel.message, encode(message, HEADER))[1] == message


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "0.1", None, True, 11.0, [0.1]])
def test_a_speed_that_is_no_finite_number_in_range_is_refused(bad: Any) -> None:
    payload = repacked(encode(COMMAND, HEADER), lambda s, h, b: (s, h, {**b, "v_m_s": bad}))
    with pytest.raises(MessageError, match="v_m_s"):
        decode(Command, payload)


@pytest.mark.parametrize("schema", ["command/2", "leader_state/1", "", 7, None])
def test_another_schema_or_version_is_refused(schema: Any) -> None:
    payload = repacked(encode(COMMAND, HEADER), lambda _s, h, b: (schema, h, b))
    with pytest.raises(MessageError, match="schema"):
        decode(Command, payload)


def test_unknown_and_missing_fields_are_refused() -> None:
    with pytest.raises(MessageError, match="extra"):
        decode(Command, repacked(encode(COMMAND, HEADER), lambda s, h, b: (s, h, {**b, "extra": 1})))
    without = repacked(encode(COMMAND, HEADER), lambda s, h, b: (s, h, {k: v for k, v in b.items() if k != "epoch"}))
    with pytest.raises(MessageError, match="epoch"):
        decode(Command, without)


def test_a_changed_bit_is_refused_unless_it_cannot_be_decoded_anyway() -> None:
    payload = encode(COMMAND, HEADER)
    for position in range(len(payload)):
        for bit in range(8):
            changed = bytearray(payload)
            changed[position] ^= 1 << bit
            with pytest.raises(MessageError):
                decode(Command, bytes(changed))


@given(st.binary(max_size=200))
def test_garbage_is_refused_by_name(garbage: bytes) -> None:
    with pytest.raises(MessageError):
        decode(Command, garbage)


def test_deep_nesting_and_size_are_refused() -> None:
    with pytest.raises(MessageError):
        decode(Command, b"\x91" * 5000)
    with pytest.raises(MessageError, match="bytes"):
        decode(Command, b"\x00" * 70_000)


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Command) if f.name != "checksum"])
def test_the_end_to_end_checksum_covers_every_field(field: str) -> None:
    changed = dataclasses.replace(COMMAND, **{field: getattr(COMMAND, field) + 1})
    assert command_checksum(changed) != COMMAND.checksum
