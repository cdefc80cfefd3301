"""Waiting for what happens in other processes."""

from __future__ import annotations

import time
from typing import Any

import pytest


def until(condition: Any, seconds: float) -> None:
    """Wait for a condition, or fail."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail("waited in vain")
        time.sleep(0.01)
