"""A user's mistake in the configuration is one line that names the file and the key."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.config import load_config
from common.errors import ConfigError
from sim.world_config import world_config


def test_the_reference_is_valid_with_its_world(config_path: Path) -> None:
    config = load_config(config_path)
    assert world_config(config, str(config_path)).start_pose.x_m == -6.0
    assert config.docking.goal(8).x_m == pytest.approx(1.5 + 0.28 * 7)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("camera.exposre_us=1", "camera.exposre_us: unknown key"),
        ("camera.gain=-1.0", "camera.gain: Input should be greater than 0, got -1.0"),
        ("camera.gain=nan", "camera.gain: Input should be a finite number"),
        ("camera.width_px=1280.0", "camera.width_px"),
        ("controller.horizon='x'", "controller.horizon"),
        ("follower_can.lift.node_id=1", "node id 1 is given twice"),
        ("leds.positions_m=[[0,-0.3,1.4],[0,0,1.4],[0,0.1,1.4],[0,0.3,1.4]]", "collinear"),
        ("leds.positions_m=[[0,-0.28,1.38],[0,0,1.40],[0,0.28,1.42],[0,-0.1,1.8]]", "LEDs 0, 1, 2 are collinear"),
        ("leds.positions_m=[[0,-0.28,1.38],[0,-0.28,1.38],[0,0.1,1.8],[0,-0.24,1.72]]", "LEDs 0 and 1 lie within"),
        ("leds.positions_m=[[0,-0.3,1.4],[0.5,0.1,1.4],[0,0.1,1.8],[0,-0.3,1.7]]", "not coplanar"),
        ("leds.positions_m=[[0,-0.3,1.4],[0,0.3,1.4],[0,0.2,1.8],[0,-0.2,1.8]]", "symmetric"),
        ("camera.mount_xyz_m=[0.25,0.0,1.40]", "Δh = 0"),
        ("docking.goal_distance_m=0.5", "outside the image"),
        ("limits.w_max_rad_s=5.0", "limits.w_max_rad_s"),
        ("nonsense", "table.key=value"),
    ],
)
def test_mistakes_are_one_line_with_the_key(config_path: Path, override: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(config_path, [override])
    text = str(caught.value)
    assert said in text
    assert "\n" not in text
    assert override == "nonsense" or str(config_path) in text


def test_the_worlds_table_is_checked_too(config_path: Path) -> None:
    config = load_config(config_path, ["world.wheel_lagg_s=0.1"])
    with pytest.raises(ConfigError, match=r"\[world\]: wheel_lagg_s: unknown key"):
        world_config(config, str(config_path))


def test_missing_and_broken_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read"):
        load_config(tmp_path / "absent.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("[camera\n")
    with pytest.raises(ConfigError, match=r"broken\.toml: not valid TOML"):
        load_config(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"broken\.toml: line 1 is not UTF-8"):
        load_config(broken)


HUGE = "9" * 5000


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "deep = " + "[" * 3000 + "]" * 3000 + "\n"),
        ("", "deep = " + "{a=" * 2000 + "1" + "}" * 2000 + "\n"),
        ("", ".".join(["a"] * 300) + " = 1\n"),
        ("track_m = 0.50", f"track_m = {HUGE}"),
        ("track_m = 0.50", f"track_m = {HUGE[:400]}"),
        ("track_m = 0.50", "track_m = 1e300"),
        ("wheel_radius_m = 0.085", "wheel_radius_m = 1e-300"),
        ("wheel_radius_m = 0.085", "wheel_radius_m = 0.0085"),
        ("gear_ratio = 20.0", "gear_ratio = 1e-9"),
        ("-0.163624", "1e300"),
    ],
)
def test_what_no_robot_can_be_is_one_short_line(tmp_path: Path, config_path: Path, before: str, after: str) -> None:
    text = config_path.read_text()
    assert before in text
    path = tmp_path / "own.toml"
    path.write_text(text.replace(before, after, 1) if before else after + text)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(path))


@pytest.mark.parametrize("override", ["=", ".=1", "base..x=1", "base.track_m=" + "[" * 3000, f"base.track_m={HUGE}"])
def test_hostile_overrides_are_one_short_line(config_path: Path, override: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(config_path, [override])
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(config_path))


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path, config_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(b"\xef\xbb\xbf" + config_path.read_bytes())
    assert load_config(path).model_dump() == load_config(config_path).model_dump()


def test_a_missing_table_is_named(tmp_path: Path, config_path: Path) -> None:
    text = config_path.read_text()
    part = tmp_path / "part.toml"
    part.write_text(text.replace("[leader]", "[world.leader]"))
    with pytest.raises(ConfigError, match="leader: Field required"):
        load_config(part)
