"""What another method or setting would have estimated and commanded on the same inputs, beside what was recorded.

The loop is open: the robot in the recording drove as it was commanded then, whatever comes out now.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from common.channels import COMMAND, DOCKING_STATE, Channel
from common.config import Config
from common.errors import ConfigError
from common.messages import MessageError, decode
from common.recording.recording import Recording
from common.recording.steps import Sent
from common.timing import NS_PER_S
from station.replay.core import Segment, Step, longest_run, replayed
from station.replay.recorded_devices import DivergedError

_FIELDS: dict[str, tuple[Channel[Any], tuple[str, ...]]] = {
    "estimator": (DOCKING_STATE, ("x_m", "y_m", "theta_rad", "residual_px")),
    "controller": (COMMAND, ("v_m_s", "w_rad_s")),
}
_PAPER = "paper_fatrop"


@dataclass
class FieldTrace:
    """One field over time [s]: as recorded and as it would have been, NaN where there was no output."""

    core: str
    name: str
    time_s: list[float] = field(default_factory=list)
    recorded: list[float] = field(default_factory=list)
    other: list[float] = field(default_factory=list)

    def row(self) -> dict[str, Any]:
        """What the table says of it."""
        recorded, other, time_s = np.array(self.recorded), np.array(self.other), np.array(self.time_s)
        both = np.isfinite(recorded) & np.isfinite(other)
        row: dict[str, Any] = {
            "core": self.core,
            "field": self.name,
            "recorded": int(np.isfinite(recorded).sum()),
            "other": int(np.isfinite(other).sum()),
        }
        if both.any():
            difference = np.abs(other - recorded)[both]
            worst = int(difference.argmax())
            row |= {
                "rms_recorded": _rms(recorded[both]),
                "rms_other": _rms(other[both]),
                "rms_difference": _rms(difference),
                "largest_difference": float(difference[worst]),
                "at_s": float(time_s[both][worst]),
                "smoothness_recorded": _rms(np.diff(recorded[both])) if both.sum() > 1 else 0.0,
                "smoothness_other": _rms(np.diff(other[both])) if both.sum() > 1 else 0.0,
            }
        return row


def chosen_overrides(method: str, overrides: Sequence[str]) -> list[str]:
    """``--method`` and ``--set`` as overrides: the paper's method brings its own estimate of θ with it."""
    if not method:
        return list(overrides)
    name = _PAPER if method == "paper" else method
    estimator = "paper" if name.startswith("paper") else "davpc"
    return [f'controller.method="{name}"', f'estimator.method="{estimator}"', *overrides]


def side_by_side(recording: Recording, config: Config, config_path: Path) -> list[FieldTrace]:
    """Replay estimator and controller with another configuration.

    Args:
        recording: with their inputs; without lossless frames the estimator is left out.
        config: the other configuration.
        config_path: beside which the files lie that it names.

    Raises:
        ConfigError: no journal, or the nodes ask for what it does not hold.
    """
    traces: list[FieldTrace] = []
    for core, (channel, names) in _FIELDS.items():
        if core == "estimator" and not recording.frames.there:
            continue
        run = longest_run(recording, core)
        found = [FieldTrace(core, name) for name in names]
        try:
            with replayed(recording, run, config, config_path, Segment(run.steps, None)) as node:
                for step in node.replay():
                    _append(recording, found, step, channel)
        except DivergedError as error:
            raise ConfigError(f"{recording.path}: {core}: {error}") from error
        traces += found
    return traces


def _append(recording: Recording, traces: list[FieldTrace], step: Step, channel: Channel[Any]) -> None:
    before = [_recorded(recording, sent, channel) for sent in step.recorded.outputs if sent.key == channel.key]
    after: list[Any] = [message for at, message in step.outputs if at.key == channel.key]
    if not before and not after:
        return
    recorded, other = (before or [None])[0], (after or [None])[0]
    for trace in traces:
        trace.time_s.append(step.recorded.now_ns / NS_PER_S)
        trace.recorded.append(_value(recorded, trace.name))
        trace.other.append(_value(other, trace.name))


def _recorded(recording: Recording, sent: Sent, channel: Channel[Any]) -> Any:
    payload = recording.payload(sent.key, sent.crc, sent.stamp_ns)
    try:
        return None if payload is None else decode(channel.message, payload)[1]
    except MessageError:
        return None


def _value(message: Any, name: str) -> float:
    """A number of a message; of an invalid state there is none."""
    return math.nan if message is None or not getattr(message, "valid", True) else float(getattr(message, name))


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def as_table(traces: Sequence[FieldTrace]) -> str:
    """A Markdown table."""
    heads = (
        "core",
        "field",
        "rms recorded",
        "rms other",
        "rms difference",
        "largest",
        "at s",
        "M recorded",
        "M other",
    )
    keys = ["rms_recorded", "rms_other", "rms_difference", "largest_difference", "at_s"]
    keys += ["smoothness_recorded", "smoothness_other"]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for trace in traces:
        row = trace.row()
        numbers = [f"{row[key]:.4g}" if key in row else "–" for key in keys]
        lines.append(f"| {' | '.join([trace.core, trace.name, *numbers])} |")
    return "\n".join(lines) + "\n"
