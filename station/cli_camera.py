"""``davpc camera``, ``davpc calibrate`` and ``davpc teach``: setting up what the Follower sees with."""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from common.config import ConfigError, default_config_path
from common.geometry import Array, Pose2
from station.cli_options import ConfigOption, RuntimeOption, SetOption, loaded, numbers

if TYPE_CHECKING:
    from station.calibration import Board

camera = typer.Typer(no_args_is_help=True, help="Look through the camera. `davpc camera focus`")
calibrate = typer.Typer(no_args_is_help=True, help="Calibrate lens and mounting. `davpc calibrate camera FOLDER`")
ROBOT = Path("/run/davpc")


@camera.command(epilog="Example:  davpc camera snapshot --out now.png")
def snapshot(
    out: Path = Path("snapshot.png"),
    runtime: RuntimeOption = ROBOT,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Save one frame."""
    import cv2

    from station.frames import open_frames

    with open_frames(loaded(config, overrides), config or default_config_path(), runtime) as frames:
        image = next(frames)
    if not cv2.imwrite(str(out), image):
        raise ConfigError(f"{out}: cannot be written as an image")
    typer.echo(f"{out}: {image.shape[1]}×{image.shape[0]}, brightest pixel {image.max()}")


@camera.command(epilog="Example:  davpc camera focus --runtime /run/davpc")
def focus(
    frames: Annotated[int, typer.Option(min=0, help="stop after so many; 0: until Ctrl-C")] = 0,
    runtime: RuntimeOption = ROBOT,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Show sharpness, spot size and saturation live while you turn the lens."""
    from rich.live import Live
    from rich.text import Text

    from follower.estimator.spots import SpotRule
    from station.focus import focus_report
    from station.frames import open_frames

    robots = loaded(config, overrides)
    rule = SpotRule(robots.estimator.threshold, robots.estimator.min_spot_px, robots.estimator.max_spot_px)
    best, shown = 0.0, 0
    with open_frames(robots, config or default_config_path(), runtime) as images, Live(refresh_per_second=8) as live:
        for image in images:
            report = focus_report(image, rule)
            best = max(best, report.sharpness)
            bar = "█" * round(40 * report.sharpness / best) if best else ""
            clipped = f"saturated {report.saturated_percent:.0f} %"
            line = f"{report.spots} spots  width {report.spot_width_px:.1f} px  {clipped}"
            live.update(Text(f"sharpness {report.sharpness:10.0f}  {bar}\n{line}\n{report.advice}"))
            shown += 1
            if shown == frames:
                break
            time.sleep(0.05)


@calibrate.command(
    "camera", epilog="Example:  davpc calibrate camera photos/ --board 9x6 --square-mm 25 --serial 0421"
)
def calibrate_lens(
    folder: Annotated[Path, typer.Argument(help="images of the board (png, jpg, bmp)")],
    board: Annotated[str, typer.Option(help="inner corners, columns x rows")] = "9x6",
    square_mm: Annotated[float, typer.Option(min=1)] = 25.0,
    serial: Annotated[str, typer.Option(help="of the camera, written down with the result")] = "unknown",
    out: Path = Path("calibration.toml"),
) -> None:
    """Fit the lens from photographs of a chessboard.

    Light the board evenly with a diffuse 940 nm source: the filter lets no other light through, and a torch beside
    the camera gives reflections. Show the board in every part of the image, the corners above all, and tilted.
    """
    from station.calibration import Board, CalibrationError, calibrate_camera, coverage_of
    from station.calibration_file import store

    columns, rows = (int(part) for part in numbers(board.replace("x", ","), 2))
    kind = Board(columns, rows, square_mm / 1000)
    views, size = _photographed(folder, kind)
    coverage = coverage_of(views, size)
    typer.echo(f"{len(views)} views, corners in {coverage.share:.0%} of the image")
    try:
        found = calibrate_camera(views, kind, size)
    except CalibrationError as error:
        raise ConfigError(f"{folder}: {error}") from error
    for model, error_px in found.held_out_px.items():
        typer.echo(
            f"{model:9s} {error_px:.3f} px on corners left out{'  ← chosen' if model == found.lens.model else ''}"
        )
    store(found, serial, datetime.now(UTC).date().isoformat(), size, out)
    typer.echo(f"rms {found.rms_px:.3f} px; put the table [lens] of {out} in place of camera.lens in robots.toml")


@calibrate.command("mount", epilog="Example:  davpc calibrate mount views.json")
def calibrate_mounting(
    views: Annotated[Path, typer.Argument(help='[{"pose": [x_m, y_m, theta_deg], "features": [[a, b], …]}, …]')],
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Fit the camera's place and attitude from the array seen at measured poses of {L} in {F}."""
    from station.mount import MountError, View, calibrate_mount

    robots = loaded(config, overrides)
    try:
        table = json.loads(views.read_text(encoding="utf-8"))
        seen = [
            View(
                Pose2(float(entry["pose"][0]), float(entry["pose"][1]), math.radians(entry["pose"][2])),
                np.array(entry["features"], dtype=float),
            )
            for entry in table
        ]
        mount = calibrate_mount(seen, robots.leds.points, robots.camera.mount, robots.camera.lens.fx_px)
    except OSError as error:
        raise ConfigError(f"{views}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, IndexError, MountError) as error:
        raise ConfigError(f"{views}: {error}") from error
    typer.echo(f"mount_xyz_m = [{', '.join(f'{value:.4f}' for value in mount.xyz_m)}]   # camera, in robots.toml")
    angles = ", ".join(
        f"{name} {math.degrees(value):+.3f}°"
        for name, value in (("pitch", mount.pitch_rad), ("roll", mount.roll_rad), ("yaw", mount.yaw_rad))
    )
    typer.echo(f"{angles}; residual {mount.residual_px:.2f} px")


def teach(
    trolley: Annotated[int, typer.Argument(min=1, help="K: which docking's image this is")],
    frames: Annotated[int, typer.Option(min=30, help="frames to average")] = 120,
    out: Annotated[Path | None, typer.Option(help="file to write", show_default="taught-K.json")] = None,
    runtime: RuntimeOption = ROBOT,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Store the desired image of docking K from a robot that stands at its docked pose. `davpc teach 1`

    The robot docks by it once docking.taught_dir of the configuration names the folder.
    """
    from common.bus import Bus
    from common.executor import earlier_processes
    from follower.supervisor.taught import save, taught_name
    from station.frames import TOOL, docking_states
    from station.teach import TeachError
    from station.teach import teach as average

    robots = loaded(config, overrides)
    if not runtime.is_dir():
        raise ConfigError(f"{runtime}: no robot runs here")
    with Bus(TOOL, runtime, earlier_processes(TOOL)) as bus:
        states = [state for state in docking_states(bus, frames) if state.valid]
    features = [np.array([(np.nan, np.nan) if one is None else one for one in state.features]) for state in states]
    poses = [Pose2(state.x_m, state.y_m, state.theta_rad) for state in states]
    try:
        taught = average(robots, trolley, features, poses)
    except TeachError as error:
        raise ConfigError(f"docking {trolley}: {error}") from error
    path = out or Path(taught_name(trolley))
    save(taught, path)
    summary = {key: value for key, value in asdict(taught).items() if key in ("spread_px", "offset_px", "frames")}
    typer.echo(f"{path}: {summary}; offset_px is how far geometry's image of docking {trolley} lies from it")


def _photographed(folder: Path, kind: Board) -> tuple[list[Array], tuple[int, int]]:
    """Corners of every image of the folder that shows the whole board, and the images' size."""
    import cv2

    from station.calibration import find_corners

    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".bmp"))
    if not paths:
        raise ConfigError(f"{folder}: no images (png, jpg, bmp) here")
    views, size = list[Array](), (0, 0)
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ConfigError(f"{path}: not an image")
        if size not in ((0, 0), (image.shape[1], image.shape[0])):
            raise ConfigError(f"{path}: {image.shape[1]}×{image.shape[0]} px, the others {size[0]}×{size[1]}")
        size = (image.shape[1], image.shape[0])
        corners = find_corners(np.asarray(image, np.uint8), kind)
        typer.echo(f"{path.name}: {'board found' if corners is not None else 'no whole board, left out'}")
        if corners is not None:
            views.append(corners)
    return views, size
