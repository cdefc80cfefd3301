"""Both robots and their world in stepped time, all nodes in this process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common.config import Config
from common.node import Node, NodeContext
from common.processes import ONE_MACHINE
from common.timing import SteppedClock
from tests.rigs.canbus_rig import CONFIG_PATH

EVERY = tuple(entry.name for entry in ONE_MACHINE)


def stepped_nodes(config: Config, runtime: Path, clock: SteppedClock, names: Sequence[str] = EVERY) -> list[Node]:
    """Nodes of one machine, in the order in which its processes start.

    Args:
        config: with stepped buses, as of :func:`tests.rigs.canbus_rig.stepped_config`.
        runtime: folder that they share.
        clock: theirs and the executor's.
        names: which of them.
    """
    chosen = [entry for entry in ONE_MACHINE if entry.name in names]
    return [
        entry.factory()(NodeContext(config, CONFIG_PATH, runtime, number, clock))
        for number, entry in enumerate(chosen, start=1)
    ]
