"""``davpc calibrate``: the lens from a chessboard, the mounting from the array at measured poses."""

from __future__ import annotations

import math
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.live import Live
from rich.text import Text

from common.config import Config, default_config_path
from common.errors import ConfigError
from common.files.writer import write_json
from common.geometry import Array, Pose2
from follower.camera.calibration_file import age_days, stored
from follower.camera.image_file import IMAGE_SUFFIXES, depth_of, images_in, read_grey
from station.calibrate.board import Board, counted_otherwise, coverage_of, find_corners
from station.calibrate.frames import measured, open_frames, valid_states
from station.calibrate.lens import KINDS, CalibrationError, calibrate_camera
from station.calibrate.lens_file import differences, store
from station.calibrate.live_board import BoardCollector, collect
from station.calibrate.mount import MountError, MountView, averaged, calibrate_mount, whole_tilt_rad
from station.calibrate.mount_file import load_views, save_views
from station.calibrate.robot import content, fitted, table
from station.options import ConfigOption, RuntimeOption, SetOption, loaded, numbers, writable

calibrate = typer.Typer(no_args_is_help=True, help="Calibrate lens and mounting. `davpc calibrate camera --live`")
_FEWEST_CORNERS, _MOST_CORNERS = 3, 40


@calibrate.command("camera", epilog="Example:  davpc calibrate camera --live --board 9x6 --square-mm 25")
def calibrate_lens(
    folder: Annotated[Path | None, typer.Argument(help="images of the board (png, jpg, bmp)")] = None,
    live: Annotated[
        bool, typer.Option("--live", help="collect views through the camera until the image is covered")
    ] = False,
    board: Annotated[str, typer.Option(help="inner corners, columns x rows")] = "9x6",
    square_mm: Annotated[float, typer.Option(min=1, help="side of a square")] = 25.0,
    serial: Annotated[
        str, typer.Option(help="serial number of the camera", show_default="as the driver gives it")
    ] = "",
    out: Annotated[Path, typer.Option(help="file to write")] = Path("calibration.toml"),
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Fit the lens from photographs of a chessboard, or live.

    Light the board evenly with a diffuse 940 nm source: the filter lets no other light through, and a torch beside
    the camera gives reflections. Show the board in every part of the image, the corners above all, and tilted.
    """
    shown = _board(board, square_mm)
    if live == (folder is not None):
        raise ConfigError("calibrate camera: name a folder of images, or --live")
    writable(out)
    if folder is not None:
        (views, size), origin, camera = _photographed(folder, shown), str(folder), serial or "unknown"
    else:
        views, size, camera_id = _watched(shown, loaded(config, overrides), config or default_config_path(), runtime)
        origin, camera = "calibrate camera --live", serial or camera_id
    typer.echo(f"{len(views)} views, corners in {coverage_of(views, size).share:.0%} of the image")
    try:
        found = calibrate_camera(views, shown, size)
    except CalibrationError as error:
        raise ConfigError(f"{origin}: {error}") from error
    for kind in KINDS:
        error_px = found.held_out_px.get(kind)
        text = "does not fit over the whole image" if error_px is None else f"{error_px:.3f} px on corners left out"
        typer.echo(f"{kind:10s} {text}{'  ← chosen' if kind == found.kind else ''}")
    if found.doubt:
        typer.echo(f"warning: {found.doubt}", err=True)
    store(found, camera, datetime.now(UTC).date().isoformat(), size, out)
    typer.echo(f"rms {found.rms_px:.3f} px; put the table lens of {out} in place of camera.lens in robots.toml")


@calibrate.command("check", epilog="Example:  davpc calibrate check calibration.toml")
def check(
    file: Annotated[Path, typer.Argument(help="as davpc calibrate camera wrote it")],
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Check that the configured lens and image size are those of a calibration; show how old it is."""
    calibration = stored(file)
    days = age_days(calibration, datetime.now(UTC).date(), file)
    wrong = differences(calibration, loaded(config, overrides).camera)
    text = f"{file}: camera {calibration.camera}, {days} days old, {calibration.held_out_px:.3f} px"
    if wrong:
        raise ConfigError(f"{text}: the configuration has {'; '.join(wrong)}")
    typer.echo(f"{text}: lens and image size are the configured ones")


@calibrate.command("view", epilog="Example:  davpc calibrate view 2.0,0.3,10 --out views.json")
def view(
    pose: Annotated[str, typer.Argument(help="measured pose of {L} in {F}: x_m,y_m,theta_deg")],
    out: Annotated[Path, typer.Option(help="file that the view is added to")] = Path("views.json"),
    frames: Annotated[int, typer.Option(min=30, help="frames to average")] = 60,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Add what a robot at rest sees at a measured pose to the views for `davpc calibrate mount`."""
    robots = loaded(config, overrides)
    x_m, y_m, theta_deg = numbers(pose, 3)
    writable(out)
    views = load_views(out, len(robots.leds.points)) if out.exists() else []
    features = [measured(state) for state in valid_states(robots, runtime, frames)]
    try:
        mean = averaged(features, robots.camera.lens.fx_px)
    except MountError as error:
        raise ConfigError(f"view {pose}: {error}") from error
    save_views([*views, MountView(Pose2(x_m, y_m, math.radians(theta_deg)), mean)], out)
    typer.echo(f"{out}: {len(views) + 1} views")


@calibrate.command("mount", epilog="Example:  davpc calibrate mount views.json")
def calibrate_mounting(
    views: Annotated[Path, typer.Argument(help="as davpc calibrate view wrote it, at four poses or more")],
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Fit the camera's position and attitude from the array seen at measured poses of {L} in {F}."""
    robots = loaded(config, overrides)
    camera = robots.camera
    try:
        seen = load_views(views, len(robots.leds.points))
        mount = calibrate_mount(seen, robots.leds.points, camera.mount, camera.lens.fx_px)
    except MountError as error:
        raise ConfigError(f"{views}: {error}") from error
    tilt = np.degrees(whole_tilt_rad(mount, camera.mount_tilt))
    sigma = np.degrees(mount.sigma[3:])
    typer.echo(f"mount_xyz_m = [{', '.join(f'{value:.4f}' for value in mount.xyz_m)}]   # camera, in robots.toml")
    typer.echo(f"mount_tilt_deg = [{', '.join(f'{value:.3f}' for value in tilt)}]   # pitch, roll, yaw")
    spread = ", ".join(f"{1e3 * value:.1f}" for value in mount.sigma[:3])
    angles = ", ".join(f"{value:.3f}" for value in sigma)
    typer.echo(f"residual {mount.residual_px:.2f} px; standard deviations {spread} mm, {angles}°")


@calibrate.command("robot", epilog="Example:  davpc calibrate robot run-1.mcap run-2.mcap run-3.mcap")
def robot(
    drives: Annotated[
        list[Path], typer.Argument(help="recordings of three approaches or more, from different sides")
    ],
    out: Annotated[Path, typer.Option(help="file to write")] = Path("robot-calibration.json"),
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Fit camera, LEDs, wheels and latency to recorded drives, and say what the drives cannot determine.

    What they do not determine stays near the configured value. No drive shows how the array as a whole stands in
    {L}: teach for that.
    """
    robots = loaded(config, overrides)
    writable(out)
    found = fitted(drives, robots)
    typer.echo(table(found))
    write_json(out, content(found, datetime.now(UTC).date().isoformat(), drives))
    typer.echo(f"{out}: put the values of its table configuration in place of the same keys in robots.toml")


def _board(text: str, square_mm: float) -> Board:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        columns = rows = 0
    if not all(_FEWEST_CORNERS <= count <= _MOST_CORNERS for count in (columns, rows)):
        raise ConfigError(f"--board {text}: write inner corners such as 9x6, {_FEWEST_CORNERS} or more each way")
    return Board(columns, rows, square_mm / 1000)


def _watched(
    kind: Board, robots: Config, path: Path, runtime: Path | None
) -> tuple[list[Array], tuple[int, int], str]:
    """Views taken live, the images' size, the camera's name; Ctrl-C ends the collecting, not the command."""
    collector = BoardCollector(kind, (robots.camera.width_px, robots.camera.height_px))
    camera_id = "unknown"
    with (
        open_frames(robots, path, runtime) as images,
        Live(refresh_per_second=8) as screen,
        suppress(KeyboardInterrupt),
    ):

        def show() -> None:
            state = "board in sight" if collector.found else "no whole board in sight"
            text = f"{collector.grid()}\n{len(collector.views)} views, {state}\n{collector.missing or 'enough'}"
            screen.update(Text(text))

        first = next(images)
        camera_id = first.camera_id
        collect((taken.image for taken in images), collector, show)
    return collector.views, collector.size, camera_id


def _photographed(folder: Path, kind: Board) -> tuple[list[Array], tuple[int, int]]:
    """Corners of every image of the folder that shows the whole board, and the images' size."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder: name the one that holds the images")
    paths = sorted(images_in(folder))
    if not paths:
        raise ConfigError(f"{folder}: no images ({', '.join(IMAGE_SUFFIXES)}) here")
    full_scale = (1 << max(depth_of(paths), 8)) - 1
    views, size = list[Array](), (0, 0)
    for path in paths:
        image = read_grey(path, full_scale)
        if image is None:
            raise ConfigError(f"{path}: truncated, or not an image")
        if size not in ((0, 0), (image.shape[1], image.shape[0])):
            raise ConfigError(f"{path}: {image.shape[1]}×{image.shape[0]} px, the others {size[0]}×{size[1]}")
        size = (image.shape[1], image.shape[0])
        corners = find_corners(image, kind)
        typer.echo(f"{path.name}: {'board found' if corners is not None else 'no whole board, left out'}")
        if corners is not None:
            views.append(corners)
        elif not views:
            other = counted_otherwise(image, kind)
            if other:
                raise ConfigError(f"{path}: {other}")
    return views, size
