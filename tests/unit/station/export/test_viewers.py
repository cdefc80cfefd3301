"""What a file for viewers holds, made of a recording without any of it."""

from __future__ import annotations

from pathlib import Path

from common.recording import scene
from common.recording.recording import Recording
from common.recording.views import PREFIX
from station.export.viewers import write_views
from tests.rigs.recorded_run import recorded_run


def test_views_made_later_are_those_made_at_once(tmp_path: Path) -> None:
    recording = Recording.read(recorded_run())
    again = Recording.read(write_views(recording, tmp_path / "run.foxglove.mcap"))
    for topic in ("follower/state/docking", "journal/leader", scene.IMAGE, scene.TRANSFORMS, scene.SCENE):
        assert [each.data for each in again.topics[topic]] == [each.data for each in recording.topics[topic]], topic
    views = PREFIX + "follower/motion/mission"
    assert [each.data for each in again.topics[views]] == [each.data for each in recording.topics[views]]
    assert again.config.model_dump_json() == recording.config.model_dump_json()
