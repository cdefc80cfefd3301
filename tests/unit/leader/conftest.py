"""Steady light: what is tested here does not depend on the code."""

from __future__ import annotations

import pytest

from common.config import Config, load_config
from experiments.shared.steady import steady
from tests.rigs.canbus_rig import CONFIG_PATH


@pytest.fixture(scope="session")
def config() -> Config:
    """The reference robots without a light code."""
    return steady(load_config(CONFIG_PATH))
