"""A docking sequence with an obedient robot."""

from __future__ import annotations

import pytest

from common.config import Config
from tests.rigs.supervisor_rig import Bench


@pytest.fixture
def bench(config: Config) -> Bench:
    return Bench(config)
