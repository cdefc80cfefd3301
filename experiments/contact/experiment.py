"""``davpc experiment contact``: is contact recognised in every push, and never on an approach over rubber pads?

Pushes: speed, load, rolling resistance, friction in the arms, wheel gain and lateral error vary; the trolley is
pushed from the goal into the Leader's guide. Recognised: ``contact`` while the guide resists and before the beam is
seated, then ``connected`` behind its seat, and neither before. Approaches: two to four pads with edges to climb, at
up to 0.4 m/s; any contact, connection, slip or collision is false. ``by_torque_alone`` counts approaches on which
torque without the visual error would have reported contact. The arms' own code runs closed-loop at 100 Hz
against the simulated arms, trolley and guide; no CAN, camera or controller.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config, default_config_path, load_config
from common.geometry import Array
from experiments.contact.handle_bench import ContactBench, Sample
from experiments.contact.plot import draw_contact
from experiments.shared.executor import ALONE, Workers, run_all
from experiments.shared.results import row, write_results
from sim.physics.trolley import RubberPad
from sim.world_config import WorldConfig, world_config

LOAD_KG = (15.0, 35.0)
PUSH_M_S = (0.03, 0.05)
APPROACH_M_S = (0.15, 0.40)
PAD_HEIGHT_M = (0.001, 0.003)
_ROLL_UP_M = 0.03
_APPROACH_M = 1.0
_END_OF_APPROACH_M = -0.16
_STOPS_AFTER_CYCLES = 6
_STANDS_CYCLES = 30
_PUSH_LIMIT_M = 0.25
_MOST_CYCLES = 2500
_LASTING_CYCLES = 15


@dataclass(frozen=True)
class ContactJob:
    """One run: ``push`` or ``approach``, its number and the campaign's seed; the configuration as JSON."""

    case: str
    number: int
    seed: int
    config_text: str


@dataclass(frozen=True)
class PushRun:
    """Result of one push: the beam [m in {L}] and force [N] at contact and connection, NaN for never."""

    recognised: bool
    early: bool
    contact_beam_m: float
    contact_force_n: float
    connected_force_n: float
    peak_force_n: float


def run(
    out: Path, seed: int = 1, trials: int = 100, config: Config | None = None, workers: Workers = ALONE
) -> dict[str, Any]:
    """Run both campaigns; write ``results.json``, ``table.md`` and ``contact.png``.

    Args:
        out: folder for the results; made if missing.
        seed: random seed of loads, speeds and pads; the same seed gives the same results with any ``workers``.
        trials: pushes, and approaches.
        config: the robots; None: the default configuration.
        workers: who does the runs.
    """
    robots = config if config is not None else load_config(default_config_path())
    text = robots.model_dump_json()
    pushes = run_all(push_job, [ContactJob("push", i, seed, text) for i in range(trials)], workers, "pushes")
    alarms = run_all(
        approach_job, [ContactJob("approach", i, seed, text) for i in range(trials)], workers, "approaches"
    )
    rows = [
        row("davpc", "push", trials, _push_metrics(pushes)),
        row("davpc", "approach over pads", trials, _approach_metrics(alarms)),
    ]
    settings = {"load_kg": LOAD_KG, "push_m_s": PUSH_M_S, "approach_m_s": APPROACH_M_S, "pad_height_m": PAD_HEIGHT_M}
    results = write_results(out, "contact", seed, {"trials": trials, **settings}, rows, [], robots)
    _, pushed = push_samples(ContactJob("push", 0, seed, text))
    _, rolled = approach_samples(ContactJob("approach", 0, seed, text))
    draw_contact(_columns(pushed), _columns(rolled), robots.arms, out / "contact.png")
    return results


def push_job(job: ContactJob) -> PushRun:
    """One push."""
    world, samples = push_samples(job)
    touches, ends = world.guide_ramp_m
    contact = next((s for s in samples if s.state.contact), None)
    connected = next((s for s in samples if s.state.connected), None)
    early = any((s.state.contact and s.beam_x_m < touches) or (s.state.connected and not s.seated) for s in samples)
    fine = contact is not None and connected is not None and contact.beam_x_m <= ends
    return PushRun(
        recognised=fine and not early and all(s.state.cause == "ok" for s in samples),
        early=early,
        contact_beam_m=contact.beam_x_m if contact else float("nan"),
        contact_force_n=contact.handle_force_n if contact else float("nan"),
        connected_force_n=connected.handle_force_n if connected else float("nan"),
        peak_force_n=max(s.handle_force_n for s in samples),
    )


def approach_job(job: ContactJob) -> tuple[bool, bool]:
    """Whether one approach gave any alarm, and whether it would have by torque alone."""
    _, samples = approach_samples(job)
    threshold_n = _config(job.config_text).arms.contact_force_n
    above = lasted = 0
    for sample in samples:
        risen = sample.state.handle_force_n - sample.state.resistance_n > threshold_n
        above = above + 1 if risen else 0
        lasted = max(lasted, above)
    alarm = any(s.state.contact or s.state.connected or s.state.cause != "ok" for s in samples)
    return alarm, lasted >= _LASTING_CYCLES


def push_samples(job: ContactJob) -> tuple[WorldConfig, list[Sample]]:
    """One push as the supervisor does it: it stops 60 ms after ``connected``."""
    config, random = _config(job.config_text), np.random.default_rng([job.seed, job.number, 1])
    world = _world(config, job, random)
    speed = float(random.uniform(*PUSH_M_S))
    bound = config.docking.lateral_bound_first_m
    beam = world.guide_ramp_m[0] - 0.05
    bench = ContactBench(config, world, beam - _ROLL_UP_M, lateral_m=float(random.uniform(-0.8, 0.8)) * bound)
    samples: list[Sample] = []
    connected_for = 0
    while len(samples) < _MOST_CYCLES and connected_for < _STANDS_CYCLES:
        push = bench.contact.beam_x_m >= beam - 0.002
        samples.append(bench.cycle(speed if connected_for < _STOPS_AFTER_CYCLES else 0.0, push))
        connected_for += samples[-1].state.connected
        if bench.contact.beam_x_m - beam > _PUSH_LIMIT_M:
            break
    return world, samples


def approach_samples(job: ContactJob) -> tuple[WorldConfig, list[Sample]]:
    """One approach over pads: up to speed, across, and slowing down before the goal."""
    config, random = _config(job.config_text), np.random.default_rng([job.seed, job.number, 2])
    world = _world(config, job, random)
    speed = float(random.uniform(*APPROACH_M_S))
    end = _END_OF_APPROACH_M
    edges = np.sort(random.uniform(end - _APPROACH_M + 0.2, end, 2 * int(random.integers(2, 5))))
    pads = tuple(
        RubberPad(float(near), float(far), float(random.uniform(*PAD_HEIGHT_M)))
        for near, far in zip(edges[0::2], edges[1::2], strict=True)
    )
    bench = ContactBench(config, world, end - _APPROACH_M, pads)
    samples: list[Sample] = []
    while len(samples) < _MOST_CYCLES:
        left_m = end - bench.contact.beam_x_m
        # the same deceleration as the controller's cap at its steepest
        wanted = min(speed, (0.3 * max(0.0, left_m)) ** 0.5)
        samples.append(bench.cycle(wanted, contact_expected=False))
        if left_m < 0.01:
            break
    return world, samples


@cache
def _config(text: str) -> Config:
    return Config.model_validate_json(text)


def _world(config: Config, job: ContactJob, random: np.random.Generator) -> WorldConfig:
    """The plant with this run's load and friction."""
    load_kg = float(random.uniform(*LOAD_KG))
    drawn = {
        "seed": job.seed + job.number,
        "trolley_mass_kg": load_kg,
        "rolling_resistance": float(random.uniform(0.012, 0.03)),
        "load_gain_per_kg": float(random.uniform(-0.15, 0.0)) / load_kg,
        "joint_friction_n_m": float(random.uniform(0.15, 0.5)),
        "joint_torque_error": float(random.uniform(-0.04, 0.04)),
        "link_error": float(random.uniform(-0.004, 0.004)),
    }
    return world_config(config, "contact").model_copy(update=drawn)


def _push_metrics(runs: list[PushRun]) -> dict[str, float]:
    return {
        "recognised": float(sum(run.recognised for run in runs)),
        "early": float(sum(run.early for run in runs)),
        "contact_depth_mm": 1000 * float(np.nanmedian([run.contact_beam_m + 0.10 for run in runs])),
        "contact_n": float(np.nanmedian([run.contact_force_n for run in runs])),
        "connected_n": float(np.nanmedian([run.connected_force_n for run in runs])),
        "peak_n": max(run.peak_force_n for run in runs),
    }


def _approach_metrics(alarms: list[tuple[bool, bool]]) -> dict[str, float]:
    return {
        "false_contacts": float(sum(alarm for alarm, _ in alarms)),
        "by_torque_alone": float(sum(alone for _, alone in alarms)),
    }


def _columns(samples: list[Sample]) -> dict[str, Array]:
    """Samples as columns for the picture."""
    return {
        "time_s": np.array([s.time_s for s in samples]),
        "true_n": np.array([s.handle_force_n for s in samples]),
        "felt_n": np.array([s.state.handle_force_n for s in samples]),
        "resistance_n": np.array([s.state.resistance_n for s in samples]),
        "contact": np.array([float(s.state.contact) for s in samples]),
        "connected": np.array([float(s.state.connected) for s in samples]),
    }
