"""What a stepped collection runs with."""

from __future__ import annotations

from common.config import Config
from experiments.queues.run import plan, planned_config
from sim.world_config import world_config


def test_a_later_trolley_starts_with_the_others_in_the_queue(config: Config) -> None:
    planned = planned_config(plan(config, first=5, start=[8.0, 0.5, 0.0], scene="glass_hall", seed=9))
    world = world_config(planned, "plan")
    assert (world.docked, world.scene, world.seed) == (4, "glass_hall", 9)
    assert planned.follower_can.bus.interface == planned.leader_can.bus.interface == "stepped"
    assert config.world["seed"] != 9
