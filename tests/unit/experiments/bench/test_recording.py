"""What the recorder may cost."""

from __future__ import annotations

import pytest

from experiments.bench.recording import misses


@pytest.mark.parametrize(
    ("off_ms", "on_ms", "share", "words"),
    [
        (5.0, 5.9, 7.9, []),
        (20.0, 21.9, 7.9, []),
        (5.0, 6.1, 3.0, ["p99 6.10 ms"]),
        (20.0, 22.1, 9.0, ["p99 22.10 ms", "9.0 % of a core"]),
        (None, 6.0, None, ["not measured", "recorder takes not measured"]),
    ],
)
def test_limits(off_ms: float | None, on_ms: float, share: float | None, words: list[str]) -> None:
    found = misses({"image_to_can_p99_ms": off_ms}, {"image_to_can_p99_ms": on_ms, "recorder_cpu_percent": share})
    assert len(found) == len(words)
    assert all(word in line for word, line in zip(words, found, strict=True))
