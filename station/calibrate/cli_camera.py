"""``davpc camera`` and ``davpc teach``: what the Follower sees, and what it has to see when it has docked."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import cv2
import typer
from rich.live import Live
from rich.text import Text

from common.config import default_config_path
from common.errors import ConfigError
from common.geometry import Pose2
from follower.estimator.spots import SpotRule
from follower.model.taught import save, taught_name
from station.calibrate.focus import focus_report
from station.calibrate.frames import measured, open_frames, valid_states
from station.calibrate.teach import TeachError, as_configured
from station.calibrate.teach import teach as average
from station.options import ConfigOption, RuntimeOption, SetOption, loaded, writable

taught = typer.Typer()
camera = typer.Typer(no_args_is_help=True, help="Look through the camera. `davpc camera focus`")


@camera.command(epilog="Example:  davpc camera snapshot --out now.png")
def snapshot(
    out: Annotated[Path, typer.Option(help="file to write")] = Path("snapshot.png"),
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Save one frame."""
    if not cv2.haveImageWriter(str(out)):
        raise ConfigError(f"{out}: no kind of image that can be written: name it .png")
    writable(out)
    with open_frames(loaded(config, overrides), config or default_config_path(), runtime) as images:
        image = next(images).image
    if not cv2.imwrite(str(out), image):
        raise ConfigError(f"{out}: cannot be written as an image")
    typer.echo(f"{out}: {image.shape[1]}×{image.shape[0]}, brightest pixel {image.max()}")


@camera.command(epilog="Example:  davpc camera focus --runtime /run/davpc")
def focus(
    frames: Annotated[int, typer.Option(min=0, help="stop after so many; 0: until Ctrl-C")] = 0,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Show sharpness, spot size and saturation live while you turn the lens."""
    robots = loaded(config, overrides)
    rule = SpotRule(robots.estimator.threshold, robots.estimator.min_spot_px, robots.estimator.max_spot_px)
    best, shown = 0.0, 0
    with open_frames(robots, config or default_config_path(), runtime) as images, Live(refresh_per_second=8) as live:
        for taken in images:
            report = focus_report(taken.image, rule)
            best = max(best, report.sharpness)
            bar = "█" * round(40 * report.sharpness / best) if best else ""
            clipped = f"saturated {report.saturated_percent:.0f} %"
            line = f"{report.spots} spots  width {report.spot_width_px:.1f} px  {clipped}"
            live.update(Text(f"sharpness {report.sharpness:10.0f}  {bar}\n{line}\n{report.advice}"))
            shown += 1
            if shown == frames:
                break
            time.sleep(0.05)


@taught.command(epilog="Example:  davpc teach 1 --runtime /run/davpc")
def teach(
    trolley: Annotated[int, typer.Argument(min=1, help="K: which docking's image this is")],
    frames: Annotated[int, typer.Option(min=30, help="frames to average")] = 120,
    out: Annotated[Path | None, typer.Option(help="file to write", show_default="taught-K.json")] = None,
    runtime: RuntimeOption = None,
    config: ConfigOption = None,
    overrides: SetOption = None,
) -> None:
    """Store the desired image of docking K from a robot that stands at its docked pose. `davpc teach 1`

    Once docking.taught_dir of the configuration names the folder, estimator, controller and supervisor go by it from
    their next start on. All dockings gain, most if a second one is taught, three or more trolleys on.
    """
    robots = loaded(config, overrides)
    path = writable(out or Path(taught_name(trolley)))
    states = valid_states(robots, runtime, frames)
    poses = [Pose2(state.x_m, state.y_m, state.theta_rad) for state in states]
    try:
        geometry = states[-1].geometry if states else ""
        features = as_configured(
            robots, config or default_config_path(), geometry, [measured(state) for state in states]
        )
        taught = average(robots, trolley, features, poses)
    except TeachError as error:
        raise ConfigError(f"docking {trolley}: {error}") from error
    save(taught, path)
    summary = {key: value for key, value in asdict(taught).items() if key in ("spread_px", "offset_px", "frames")}
    typer.echo(f"{path}: {summary}; offset_px is how far geometry's image of docking {trolley} lies from it")
