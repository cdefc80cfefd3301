"""What the robots decided in the reference recordings they decide again, to the bit."""

from __future__ import annotations

import math

import pytest

from common.recording.recording import Recording
from common.recording.run import versions
from station.replay.compare import ReplayVerdict, judge
from tests.reference.scenarios import CORES, SCENARIOS, stored
from tests.rigs.canbus_rig import CONFIG_PATH

UPDATE = "if that is meant: python -m tests.reference.update, and look at what it prints"
_LAST_BITS = 1e-6


def nearly(verdict: ReplayVerdict) -> bool:
    """Equal but for the last bits, which numerical libraries round by the processor that they find."""
    numbers = [most for name, (_, most) in verdict.fields.items() if not name.endswith("checksum")]
    return not verdict.stopped and all(not math.isnan(most) and most < _LAST_BITS for most in numbers)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_same_is_decided_again(name: str) -> None:
    recording = Recording.read(stored(name))
    same_machine = all(recording.about.get(key) == version for key, version in versions().items())
    for core in CORES:
        verdict = judge(core, recording, recording.config, CONFIG_PATH, fresh=True)
        lines = "\n".join([*verdict.summary(), UPDATE])
        assert verdict.identical or (not same_machine and nearly(verdict)), lines
