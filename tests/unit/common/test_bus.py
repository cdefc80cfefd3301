"""The runtime directory: a process's own, with no link that leads elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.bus import Bus
from common.errors import ConfigError


def test_a_directory_that_others_may_write_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(ConfigError, match="others may write here"):
        Bus("leader", tmp_path, [])


def test_a_link_in_place_of_the_lock_file_is_refused_and_its_target_kept(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "leader.owner").symlink_to(victim)
    with pytest.raises(ConfigError, match=r"leader\.owner: cannot be opened"):
        Bus("leader", tmp_path, [])
    assert victim.read_text() == "precious"


def test_a_missing_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="absent: cannot be opened: No such file"):
        Bus("leader", tmp_path / "absent", [])


def test_a_second_process_of_one_name_is_refused(tmp_path: Path) -> None:
    with Bus("leader", tmp_path, []), pytest.raises(ConfigError, match="a process leader already runs here"):
        Bus("leader", tmp_path, [])
