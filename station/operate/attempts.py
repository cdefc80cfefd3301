"""The reports of attempts: read, summed up, and a calibration that drifts named by its repeated signed bias."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from common.config import NonNegative
from common.errors import ConfigError
from common.files.parsing import MOST_BYTES, UnreadableError, parse_json
from follower.supervisor.journal import ATTEMPTS_FILE as ATTEMPTS_FILE

_Count = Annotated[int, Field(ge=0, lt=2**31)]
_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_FEWEST_FOR_BIAS = 5
_SURE = 4.0  # standard errors
# smaller than this a bias does not matter, however sure it is
_MATTERS = {"e_x_cm": 2.0, "e_y_cm": 1.0, "e_theta_deg": 0.5}


class _Part(BaseModel):
    """Strict about what is read, silent about what else a record has."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", allow_inf_nan=False)


class Errors(_Part):
    """Estimated error against the goal, signed."""

    e_x_cm: _Number
    e_y_cm: _Number
    e_theta_deg: _Number


class GateCounts(_Part):
    """How often the gate intervened."""

    interventions: _Count


class Record(_Part):
    """One attempt: what the summary needs of the supervisor's report."""

    form: Annotated[Literal["attempt/1"], Field(alias="schema")]
    docked: bool
    code: Annotated[str, Field(max_length=400)]
    arrival: Errors | None
    connected: Errors | None
    margins: dict[str, _Number]
    gate: GateCounts
    retries: _Count
    pauses: dict[str, _Count]
    duration_s: NonNegative


@dataclass(frozen=True)
class Summary:
    """The last attempts together: errors are means of magnitudes where they arrived."""

    attempts: int
    docked: int
    unreadable: int
    causes: dict[str, int]
    mean_e_y_cm: float | None
    mean_e_theta_deg: float | None
    mean_duration_s: float | None
    retries: int
    pauses: int
    interventions: int
    least_margins: dict[str, float]
    warnings: tuple[str, ...]


def read_attempts(path: Path, last: int) -> tuple[list[Record], int]:
    """The newest ``last`` records and how many lines could not be read: one that a power cut tore costs no other.

    Raises:
        ConfigError: there is no such file.
    """
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - MOST_BYTES))
            lines = file.read(MOST_BYTES).decode(errors="replace").split("\n")
    except OSError as error:
        raise ConfigError(
            f"{path}: no reports of attempts ({error.strerror}): name their folder with --state"
        ) from error
    found, unreadable = [], 0
    for line in [line for line in lines if line.strip()][-last:]:
        try:
            found.append(Record.model_validate(parse_json(line)))
        except (UnreadableError, ValidationError):
            unreadable += 1
    return found, unreadable


def summarise(records: list[Record], unreadable: int) -> Summary:
    """Sum records up."""
    arrivals = [record.arrival for record in records if record.arrival is not None]
    docked = [record for record in records if record.docked]
    margins: dict[str, float] = {}
    for record in records:
        for name, value in record.margins.items():
            margins[name] = min(value, margins.get(name, math.inf))
    return Summary(
        attempts=len(records),
        docked=len(docked),
        unreadable=unreadable,
        causes=dict(Counter(record.code for record in records if not record.docked).most_common()),
        mean_e_y_cm=_mean([abs(arrival.e_y_cm) for arrival in arrivals]),
        mean_e_theta_deg=_mean([abs(arrival.e_theta_deg) for arrival in arrivals]),
        mean_duration_s=_mean([record.duration_s for record in docked]),
        retries=sum(record.retries for record in records),
        pauses=sum(sum(record.pauses.values()) for record in records),
        interventions=sum(record.gate.interventions for record in records),
        least_margins=margins,
        warnings=biases(records),
    )


def biases(records: list[Record]) -> tuple[str, ...]:
    """What the docked poses show of the calibration.

    Where trolleys are rigidly connected the queue holds the Follower in place, so the error that the camera measures
    there is its own. One that is the same each time is no noise: lens, mounting or array are no longer as measured.
    Along x the reference is the wheels alone, from where the camera itself reported the arrival: there a wrong scale
    shows, over the push, and a constant offset does not.

    Args:
        records: of attempts, as :func:`read_attempts` gives them.

    Returns:
        One warning for each error whose mean matters and is sure.
    """
    found = []
    held = [record.connected for record in records if record.connected is not None]
    for name, matters in _MATTERS.items():
        values = [float(getattr(row, name)) for row in held]
        if len(values) < _FEWEST_FOR_BIAS:
            continue
        mean = fmean(values)
        error = max(stdev(values), 1e-3) / math.sqrt(len(values))
        if abs(mean) > matters and abs(mean) > _SURE * error:
            found.append(
                f"{name}: {mean:+.2f}, mean of {len(values)} docked poses: the calibration drifts "
                "(davpc calibrate check)"
            )
    return tuple(found)


def _mean(values: list[float]) -> float | None:
    return fmean(values) if values else None
