"""The arms' process."""

from __future__ import annotations

import pytest

from common.config import Config
from common.errors import ConfigError
from common.node import NodeContext
from common.timing import SteppedClock
from follower.arms.node import ArmsNode


def test_the_arms_process_does_not_start_with_a_handle_out_of_reach(config: Config, tmp_path: object) -> None:
    broken = config.model_copy(update={"arms": config.arms.model_copy(update={"handle_x_m": 0.8})})
    path = type(tmp_path)("pair.toml")  # type: ignore[call-arg]
    with pytest.raises(ConfigError, match=r"pair\.toml: arms\.handle_x_m"):
        ArmsNode(NodeContext(broken, path, path, 1, SteppedClock()))  # type: ignore[arg-type]
