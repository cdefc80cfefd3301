"""What must not grow in real processes."""

from __future__ import annotations

from experiments.soak.real import judged
from experiments.soak.resources import Held


def history(mb_per_h: float, descriptors_more: int = 0) -> list[Held]:
    return [Held(float(t), 80.0 + mb_per_h * t / 3600, 30 + descriptors_more * (t > 900), 9) for t in range(1800)]


def test_memory_has_a_limit_once_the_time_is_long_enough() -> None:
    assert judged({"leader": history(0.5)}, 450.0, 30.0) == []
    assert judged({"leader": history(3.0)}, 450.0, 30.0) == ["leader: memory grows by 3.0 MB/h, more than 1"]
    assert judged({"leader": history(3.0)}, 450.0, 5.0) == []


def test_one_more_descriptor_is_one_too_many() -> None:
    assert judged({"world": history(0.0, 1)}, 450.0, 5.0) == ["world: +1 descriptors"]
