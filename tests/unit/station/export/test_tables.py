"""A recording as tables."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from common.channels import COMMAND, DOCKING_STATE
from common.recording.recording import Recording
from station.export.tables import export, header
from tests.rigs.recorded_run import recorded_run


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording.read(recorded_run())


def test_csv_holds_every_message_to_the_last_digit(recording: Recording, tmp_path: Path) -> None:
    written = export(recording, "csv", tmp_path)
    assert {path.name for path in written} >= {"follower.state.docking.csv", "leader.state.csv", "world.state.csv"}
    with (tmp_path / "follower.motion.command.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    commands = [message for _, _, message in recording.messages(COMMAND)]
    assert [float(row["v_m_s [m/s]"]) for row in rows] == [command.v_m_s for command in commands]
    assert [int(row["capture_ns [ns]"]) for row in rows] == [command.capture_ns for command in commands]


def test_npz_loads_without_pickles(recording: Recording, tmp_path: Path) -> None:
    export(recording, "npz", tmp_path)
    table = np.load(tmp_path / "follower.state.docking.npz", allow_pickle=False)
    states = [message for _, _, message in recording.messages(DOCKING_STATE)]
    assert table["x_m [m]"].tolist() == [state.x_m for state in states]
    assert table["cause"].tolist() == [state.cause for state in states]
    assert np.isnan(table["features[0][0]"]).sum() == sum(not s.features or s.features[0] is None for s in states)


def test_parquet_keeps_the_units(recording: Recording, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    export(recording, "parquet", tmp_path)
    table = parquet.read_table(tmp_path / "follower.state.docking.parquet")
    assert table.schema.field("theta_rad").metadata[b"unit"] == b"rad"
    assert table.num_rows == len(list(recording.messages(DOCKING_STATE)))


@pytest.mark.parametrize(("name", "shown"), [("v_m_s", "v_m_s [m/s]"), ("fit[2]", "fit[2]"), ("epoch", "epoch")])
def test_headers_name_units(name: str, shown: str) -> None:
    assert header(name) == shown
