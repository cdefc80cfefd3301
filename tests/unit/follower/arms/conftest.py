"""The reference robot's arms."""

from __future__ import annotations

import pytest

from common.config import Config
from follower.arms.kinematics import ScaraArm, make_arms


@pytest.fixture(scope="module")
def arms(config: Config) -> tuple[ScaraArm, ScaraArm]:
    return make_arms(config.arms)
