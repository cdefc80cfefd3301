"""The recording thread: never in the way, counts what it drops; a killed one leaves a file that opens."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from common.recording import live
from common.recording.live import LiveRecording
from common.recording.mcap_file import Recorded, read_file
from common.recording.run import FramePictures, Item

KILLED = """
import sys, time
from pathlib import Path
from common.config import default_config_path, load_config
from common.recording.files import RecordingFiles
from common.recording.live import LiveRecording
from common.recording.run import FramePictures
path = Path(sys.argv[1])
sink = RecordingFiles(path, load_config(default_config_path()), {}, lossless=False, views=False)
kept = LiveRecording(sink, FramePictures(path.parent, 0.0, 80, lossless=False))
print("ready", flush=True)
while True:
    kept.put("some/key", bytes(300), time.monotonic_ns())
    time.sleep(0.001)
"""


class Slow:
    """A sink that waits until it may go on."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.items: list[Item] = []
        self.dropped: dict[str, int] = {}
        self.closed = False

    def take(self, item: Item) -> None:
        self.go.wait(10.0)
        self.items.append(item)

    def drop(self, key: str, count: int) -> None:
        self.dropped[key] = self.dropped.get(key, 0) + count

    def flush(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        self.closed = True


def test_a_slow_disk_drops_the_oldest_and_counts_them(tmp_path: Path) -> None:
    sink = Slow()
    kept = LiveRecording(sink, FramePictures(tmp_path, 0.0, 80, lossless=False))
    most = live._MOST_ITEMS
    for number in range(2 * most):
        kept.put("some/key", b"", number)
    sink.go.set()
    kept.close(20.0)
    assert sink.closed
    assert len(sink.items) + sink.dropped["some/key"] == 2 * most
    assert sink.items[-1].receipt_ns == 2 * most - 1
    assert kept.dropped == sink.dropped["some/key"] > 0


def test_killed_at_random_moments_it_leaves_files_that_open(tmp_path: Path) -> None:
    chance = random.Random(5)
    for number in range(4):
        path = tmp_path / f"{number}.mcap"
        with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            alive_until = time.monotonic() + 1.2 + chance.random()
            process.poll()
            threading.Event().wait(alive_until - time.monotonic())
            killed_ns = time.monotonic_ns()
            process.send_signal(signal.SIGKILL)
        last_ns = max(record.log_ns for record in read_file(path) if isinstance(record, Recorded))
        assert killed_ns - last_ns < 1_500_000_000, "a second, and what a busy host adds"
