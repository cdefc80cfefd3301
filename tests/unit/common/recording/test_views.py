"""What viewers show: every message fits the schema that its channel declares."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, unknown_fields
from mcap.reader import make_reader

from common.channels import CHANNELS
from common.recording import scene
from common.recording.units import unit_of
from common.recording.views import PREFIX, view_schema
from tests.rigs.recorded_run import recorded_run


def test_every_message_fits_its_schema() -> None:
    seen: dict[str, int] = {}
    checks: dict[int, Any] = {}
    with recorded_run().open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            seen[channel.topic] = seen.get(channel.topic, 0) + 1
            if schema is None:
                assert channel.message_encoding == "msgpack"
            elif schema.encoding == "jsonschema":
                validator = checks.setdefault(schema.id, jsonschema.Draft202012Validator(json.loads(schema.data)))
                validator.validate(json.loads(message.data))
            else:
                kind = checks.setdefault(schema.id, protobuf_type(schema.name, schema.data))
                parsed = kind.FromString(message.data)
                assert len(unknown_fields.UnknownFieldSet(parsed)) == 0
                assert parsed.SerializeToString(deterministic=True) == message.data
    assert {"follower/state/docking", "journal/follower-arms", "snapshot/leader", "world/state"} <= seen.keys()
    assert seen[PREFIX + "follower/state/docking"] == seen["follower/state/docking"]
    assert seen[scene.ANNOTATIONS] == seen["follower/state/docking"]
    assert {scene.IMAGE, scene.TRANSFORMS, scene.SCENE, scene.CALIBRATION} <= seen.keys()


def protobuf_type(name: str, data: bytes) -> Any:
    files = descriptor_pb2.FileDescriptorSet.FromString(data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.key)
def test_schemas_are_objects_that_name_units(channel: object) -> None:
    schema = json.loads(view_schema(channel.message).data)  # type: ignore[attr-defined]
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["type"] == "object"
    for name, field in schema["properties"].items():
        assert field.get("description", "") == unit_of(name) or name == "header"


@pytest.mark.parametrize(
    ("field", "unit"),
    [("v_m_s", "m/s"), ("joint_torque_n_m", "N·m"), ("capture_ns", "ns"), ("epoch", ""), ("theta_rad", "rad")],
)
def test_units_follow_the_names(field: str, unit: str) -> None:
    assert unit_of(field) == unit
