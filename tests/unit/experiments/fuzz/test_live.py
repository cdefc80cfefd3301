"""What is sent to live processes is malformed, all of it, on every channel, and the same for a seed."""

from __future__ import annotations

from itertools import islice

import pytest

from common.messages import MessageError, decode
from experiments.fuzz.live import malformed
from experiments.fuzz.messages import CHANNELS_FUZZED


def test_no_reader_may_take_any_of_it() -> None:
    sent = list(islice(malformed(1, "boot", lambda: 10**9), 2000))
    for channel, payload in sent:
        with pytest.raises(MessageError):
            decode(channel.message, payload)
    assert {channel.key for channel, _ in sent} >= {channel.key for channel in CHANNELS_FUZZED}
    assert sent == list(islice(malformed(1, "boot", lambda: 10**9), 2000))
