"""One table a channel: a column a number, with its unit in the header."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

from common.channels import channel_of
from common.errors import ConfigError
from common.messages import NodeSnapshot, StepJournal
from common.recording.recording import Recording
from common.recording.run import WORLD_KEY
from common.recording.units import unit_of
from common.recording.views import unpacked

Form = Literal["csv", "parquet", "npz"]
Table = dict[str, list[Any]]


def tables(recording: Recording) -> Iterator[tuple[str, Table]]:
    """Name and columns of each channel that holds messages; a row a message, in the order of receipt."""
    for key in sorted(recording.topics):
        channel = channel_of(key)
        if channel is not None and channel.message in (StepJournal, NodeSnapshot):
            continue
        if channel is not None:
            rows = [
                (log_ns, asdict(header), asdict(message)) for log_ns, header, message in recording.messages(channel)
            ]
        elif key == WORLD_KEY:  # of a simulation: its messages are not in the robots' table
            records = ((record.log_ns, unpacked(record.data)) for record in recording.topics[key])
            rows = [(log_ns, *content) for log_ns, content in records if content is not None]
        else:
            continue
        if rows:
            yield key.replace("/", "."), _columns(rows)


def _columns(rows: list[tuple[int, dict[str, Any], dict[str, Any]]]) -> Table:
    table: Table = {}
    for number, (log_ns, header, body) in enumerate(rows):
        row: dict[str, Any] = {"receipt_ns": log_ns, "header.stamp_ns": header.get("stamp_ns")}
        row |= {"header.run_id": header.get("run_id"), "header.sequence": header.get("sequence")}
        for name, value in body.items():
            _flatten(name, value, row)
        for name in row.keys() - table.keys():
            table[name] = [None] * number
        for name, column in table.items():
            column.append(row.get(name))
    return table


def _flatten(name: str, value: Any, row: dict[str, Any]) -> None:
    if isinstance(value, tuple | list):
        for index, item in enumerate(value):
            _flatten(f"{name}[{index}]", item, row)
    else:
        row[name] = value


def header(name: str) -> str:
    """A column's name with its unit."""
    unit = unit_of(name.partition("[")[0])
    return f"{name} [{unit}]" if unit else name


def export(recording: Recording, form: Form, out: Path) -> list[Path]:
    """Write every table into a folder; returns the files.

    Args:
        recording: to export.
        form: of the files.
        out: folder, which exists.

    Raises:
        ConfigError: the library that the form needs is not installed.
    """
    write = {"csv": _csv, "parquet": _parquet, "npz": _npz}[form]
    return [write(table, out / f"{name}.{form}") for name, table in tables(recording)]


def _csv(table: Table, path: Path) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(map(header, table))
        writer.writerows(zip(*table.values(), strict=True))
    return path


def _parquet(table: Table, path: Path) -> Path:
    try:
        import pyarrow as pa  # noqa: PLC0415 - optional
        from pyarrow import parquet  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ConfigError(f"--to parquet needs {error.name}: pip install pyarrow; or --to csv, --to npz") from error
    fields = [
        pa.field(name, array.type, metadata={"unit": unit_of(name.partition("[")[0])})
        for name, array in ((name, pa.array(column)) for name, column in table.items())
    ]
    parquet.write_table(pa.table([pa.array(column) for column in table.values()], schema=pa.schema(fields)), path)
    return path


def _npz(table: Table, path: Path) -> Path:
    np.savez_compressed(path, **{header(name): _array(column) for name, column in table.items()})
    return path


def _array(column: list[Any]) -> Any:
    """Numbers as numbers, with NaN for what is missing; anything else as text: no pickled objects."""
    given = [value for value in column if value is not None]
    if all(isinstance(value, bool) for value in given) and len(given) == len(column):
        return np.array(column, bool)
    if all(isinstance(value, int) and not isinstance(value, bool) for value in given) and len(given) == len(column):
        return np.array(column, np.int64)
    if all(isinstance(value, int | float) for value in given):
        return np.array([np.nan if value is None else value for value in column], float)
    return np.array(["" if value is None else str(value) for value in column])
