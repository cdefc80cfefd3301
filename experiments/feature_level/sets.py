"""On which starts, disturbances and noise a method is measured: the lab's, on which it was tuned, and others.

``lab``: starts and disturbances of :mod:`experiments.feature_level.scenes`, noise drawn again for each frame.
``evaluation``: other starts, pads, sizes and signs, noise held for three frames; nothing was tuned on it.
``held_out``: like it, but every run has a start, sizes, places and a combination of its own, drawn from the seed.
``training``: what ``davpc experiment tune`` searches on; drawn like ``held_out``, from another stream, and with the
lab's noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.config import Config
from common.geometry import Pose2
from experiments.feature_level.feature_world import Disturbances, Pads
from experiments.feature_level.scenes import (
    DISTURBANCES,
    DISTURBED_START,
    StartRange,
    paper_start,
    random_starts,
    starts_within,
)

SetName = Literal["lab", "evaluation", "held_out", "training"]
HELD_FRAMES = 3  # noise of a spot lasts longer than a frame: it comes from the same few pixels
DISTURBED_STARTS = StartRange(5.0, 7.5, 1.8, 45.0)  # far enough to meet all pads
_STREAMS = {"evaluation": 2, "held_out": 3, "training": 4}

_EARLY, _LATE = (3.3, 4.6), (1.7, 2.4)
EVALUATION = {
    "none": Disturbances(),
    "load": Disturbances(load_gain=0.90),
    "slip_pads": Disturbances(pads=(Pads(*_EARLY, speed_gain=0.82, turn_gain=0.70), Pads(2.2, 2.8, 0.70, 0.80))),
    "lateral_pads": Disturbances(pads=(Pads(*_EARLY, sideways_m_s=-0.03),)),
    "yaw_pads": Disturbances(pads=(Pads(*_EARLY, yaw_rad_s=-0.10),)),
    "late_yaw_pads": Disturbances(pads=(Pads(*_LATE, yaw_rad_s=-0.06),)),
    "late_lateral_pads": Disturbances(pads=(Pads(*_LATE, sideways_m_s=-0.03),)),
    "yaw_bias": Disturbances(yaw_bias_rad_s=-0.04),
    "pads_load_lag": Disturbances(
        load_gain=0.90, lag_s=0.12, pads=(Pads(*_EARLY, 0.80, 0.70, sideways_m_s=-0.03, yaw_rad_s=-0.06),)
    ),
    "late_pads_load_lag_bias": Disturbances(
        load_gain=0.90, lag_s=0.12, yaw_bias_rad_s=-0.04, pads=(Pads(*_LATE, 0.80, 0.70, yaw_rad_s=-0.06),)
    ),
}


@dataclass(frozen=True)
class Setting:
    """Runs of one case: a start and disturbances each, and for how many frames the noise stays the same."""

    starts: list[Pose2]
    disturbances: list[Disturbances]
    held_frames: int


def disturbed_setting(config: Config, chosen: SetName, name: str, trials: int, seed: int) -> Setting:
    """The runs of one kind of disturbance.

    Args:
        config: the robots.
        chosen: the set.
        name: one of ``DISTURBANCES``; outside the lab's set one of ``EVALUATION``.
        trials: how many runs.
        seed: of what is drawn: the starts, and in ``held_out`` and ``training`` the disturbances.
    """
    if chosen == "lab":
        return Setting([paper_start(DISTURBED_START)] * trials, [DISTURBANCES[name]] * trials, 1)
    stream = [seed, _STREAMS[chosen]]
    starts = starts_within(config, DISTURBED_STARTS, trials, np.random.default_rng(stream))
    if chosen == "evaluation":
        return Setting(starts, [EVALUATION[name]] * trials, HELD_FRAMES)
    place = list(EVALUATION).index(name)
    drawn = [_drawn(name, np.random.default_rng([*stream, place, i])) for i in range(trials)]
    return Setting(starts, drawn, HELD_FRAMES if chosen == "held_out" else 1)


def undisturbed_setting(config: Config, case: str, trials: int, seed: int) -> Setting:
    """The runs of a case of Table I.

    Args:
        config: the robots.
        case: ``T…`` and ``W…`` the lab's, ``E…`` of the evaluation set; ``E_white`` with noise as in the lab.
        trials: how many runs.
        seed: of the starts.
    """
    starts = random_starts(config, case, trials, seed)
    return Setting(starts, [Disturbances()] * trials, HELD_FRAMES if case == "E" else 1)


def _drawn(name: str, random: np.random.Generator) -> Disturbances:
    """Disturbances of a kind, with sizes, places and signs drawn again; of a combination, which parts too."""
    late = name.startswith("late")
    pads = []
    for _ in range(random.integers(1, 4)):
        near = random.uniform(1.6, 2.0) if late else random.uniform(2.0, 4.2)
        far = near + random.uniform(0.3, 0.7 if late else 1.3)
        pads.append(_drawn_pads(name, near, far, random))
    several = "load_lag" in name
    loaded, biased = name == "load" or several, name == "yaw_bias" or name.endswith("bias")
    return Disturbances(
        load_gain=float(random.uniform(0.80, 1.0)) if loaded else 1.0,
        lag_s=float(random.uniform(0.0, 0.2)) if several else 0.0,
        yaw_bias_rad_s=float(random.uniform(-0.05, 0.05)) if biased else 0.0,
        pads=tuple(pads) if "pads" in name else (),
    )


def _drawn_pads(name: str, near_m: float, far_m: float, random: np.random.Generator) -> Pads:
    """What a pad does: what its kind says, and in a combination each of slip, drift and yaw with even chance."""
    mixed = random.random(3) < 0.5
    slips, drifts, turns = mixed if "load_lag" in name else ("slip" in name, "lateral" in name, "yaw" in name)
    return Pads(
        near_m,
        far_m,
        speed_gain=float(random.uniform(0.70, 1.0)) if slips else 1.0,
        turn_gain=float(random.uniform(0.60, 1.0)) if slips else 1.0,
        sideways_m_s=float(random.uniform(-0.04, 0.04)) if drifts else 0.0,
        yaw_rad_s=float(random.uniform(-0.10, 0.10)) if turns else 0.0,
    )
