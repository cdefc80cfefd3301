"""A recording with what viewers show of it beside the wire's bytes."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from common.channels import FRAME
from common.recording import scene
from common.recording.recording import Recording
from common.recording.run import Item, RunRecording
from common.recording.views import PREFIX

_MADE = (PREFIX, "foxglove/")


def write_views(recording: Recording, path: Path) -> Path:
    """Write the recording again, with JSON views, poses, annotations and trolleys; pictures as they were.

    Args:
        recording: with or without views.
        path: of the new file.
    """
    records = [each for topic, found in recording.topics.items() if not topic.startswith(_MADE) for each in found]
    pictures = {each.log_ns: scene.read_image(each.data) for each in recording.topics.get(scene.IMAGE, ())}
    with path.open("wb") as stream, closing(RunRecording(stream, recording.config, recording.about)) as written:
        for record in sorted(records, key=lambda each: each.log_ns):
            picture = pictures.get(record.log_ns) if record.topic == FRAME.key else None
            capture_ns, data = picture or (0, None)
            written.add(Item(record.topic, record.data, record.log_ns, data, None, capture_ns))
    return path
