"""The scenarios of the collection."""

from __future__ import annotations

from common.config import Config
from experiments.queues.run import plan, planned_config
from experiments.queues.scenarios import SCENARIOS, ScenarioJob, world_changes
from sim.optics.scenes import SCENES
from sim.world_config import world_config


def test_scenarios_are_those_of_the_paper_and_vary_with_the_trial(config: Config) -> None:
    assert [(s.name, s.trolley) for s in SCENARIOS.values()] == [
        ("dark_outdoor", 1),
        ("parking_lot", 2),
        ("glass_hall", 5),
    ]
    text = config.model_dump_json()
    for scenario in SCENARIOS.values():
        assert scenario.scene in SCENES
        starts = {tuple(world_changes(ScenarioJob(text, scenario, 1, trial))["start"]) for trial in range(20)}
        assert len(starts) == 20
        for start in starts:
            planned = plan(config, first=scenario.trolley, scene=scenario.scene, start=list(start))
            world_config(planned_config(planned), scenario.name)
