"""What viewers show of a message: the wire's content as JSON, under a schema with the unit of each field."""

from __future__ import annotations

import json
from typing import Any

import msgpack
from pydantic import TypeAdapter

from common.messages import Header
from common.recording.mcap_file import Schema
from common.recording.units import unit_of

PREFIX = "view/"
_EXACT = 2**53  # larger integers lose digits in a viewer that is written in JavaScript


def view_schema(message_type: type[Any]) -> Schema:
    """The JSON schema of a message's view: its fields and its header, with units."""
    body, header = (TypeAdapter(kind).json_schema() for kind in (message_type, Header))
    described = _described(body)
    described["title"] = message_type.__name__
    described["description"] = (message_type.__doc__ or "").strip()
    described["properties"]["header"] = _described(header)
    described["required"] = [*described.get("required", ()), "header"]
    return Schema(f"davpc.{message_type.__name__}", "jsonschema", json.dumps(described, ensure_ascii=False).encode())


def _described(schema: dict[str, Any]) -> dict[str, Any]:
    """With the unit of each field, and with integers that may be too large for a viewer as text."""
    for name, field in schema.get("properties", {}).items():
        unit = unit_of(name)
        if unit:
            field["description"] = unit
        if field.get("type") == "integer":
            field["type"] = ["integer", "string"]
    return schema


def unpacked(payload: bytes) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Header and body of a message as it was on the wire; None where it is none."""
    try:
        _schema, header, body, _checksum = msgpack.unpackb(payload)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None
    return (header, body) if isinstance(header, dict) and isinstance(body, dict) else None


def stamp_of(payload: bytes) -> int | None:
    """When a message was published; None where it is none. Looks at its header only."""
    unpacker = msgpack.Unpacker(max_buffer_size=len(payload) + 1)
    unpacker.feed(payload)
    try:
        if unpacker.read_array_header() != 4:
            return None
        unpacker.skip()
        header = unpacker.unpack()
    except (ValueError, RecursionError, msgpack.UnpackException):
        return None
    stamp = header.get("stamp_ns") if isinstance(header, dict) else None
    return stamp if isinstance(stamp, int) and 0 <= stamp < 2**63 else None


def view(header: dict[str, Any], body: dict[str, Any]) -> bytes:
    """The view of a message as JSON."""
    content = {**_small(body), "header": _small(header)}
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"), default=str).encode()


def _small(table: dict[str, Any]) -> dict[str, Any]:
    return {
        name: str(value) if isinstance(value, int) and not -_EXACT < value < _EXACT else value
        for name, value in table.items()
    }
