"""The file of views from which the mount is calibrated."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.errors import ConfigError
from station.calibrate.mount_file import load_views


@pytest.mark.parametrize(
    ("pose", "point"), [("[NaN, 0, 0]", "[0, 0]"), ("[2, 0, 1e999]", "[0, 0]"), ("[2, 0, 0]", "[0, Infinity]")]
)
def test_views_that_are_no_numbers_are_named(tmp_path: Path, pose: str, point: str) -> None:
    path = tmp_path / "views.json"
    view = '{"pose": [2, 0, 0], "features": [null, [0, 0]]}'
    path.write_text(f'[{view}, {{"pose": {pose}, "features": [null, {point}]}}]', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"views\.json: not a list of views: .* (not a|finite) number"):
        load_views(path, 2)
