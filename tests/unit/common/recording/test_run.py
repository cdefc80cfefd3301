"""What a recording says of what it lacks."""

from __future__ import annotations

from pathlib import Path

from common.channels import FRAME
from common.recording import scene
from common.recording.files import RecordingFiles
from common.recording.recording import Recording
from common.recording.run import Item
from tests.rigs.recorded_run import recording_config


def test_frames_that_were_overwritten_and_messages_that_were_dropped_are_counted_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    files = RecordingFiles(path, recording_config(), {"seed": "1"}, lossless=True, views=False)
    files.take(Item(FRAME.key, b"note", 5, None, b"pixels", 4))
    files.take(Item(FRAME.key, b"note", 6))
    files.drop("some/key", 2)
    files.flush()
    files.drop("some/key", 3)
    files.close()
    recording = Recording.read(path)
    assert recording.dropped == {scene.FRAMES: 1, "some/key": 5}
    assert recording.frames.times_ns == {4}
