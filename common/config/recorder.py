"""What is recorded, and how much of the disk it may take."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Section


class RecorderConfig(Section):
    """The record of dockings: MCAP files in ``directory``, by default ``recordings`` beside the attempts' reports.

    ``pictures_hz`` of the camera are kept as JPEG. With ``frames = "all"`` every frame is kept
    without loss, in a file beside it, for a replay of the estimator.
    """

    journal: Annotated[bool, Field(description="whether each process journals its steps, for a replay")] = True
    directory: str = ""
    before_s: Annotated[float, Field(ge=0, le=60, description="recorded before a docking")] = 10.0
    after_s: Annotated[float, Field(ge=0, le=60, description="recorded after it")] = 2.0
    longest_s: Annotated[float, Field(ge=60, le=7200, description="of one file")] = 1800.0
    pictures_hz: Annotated[float, Field(ge=0, le=60)] = 5.0
    picture_quality: Annotated[int, Field(ge=10, le=100, description="of JPEG")] = 80
    frames: Literal["pictures", "all"] = "pictures"
    disk_mb: Annotated[int, Field(ge=50, le=1_000_000, description="of all files together")] = 2000
    frames_mb: Annotated[int, Field(ge=100, le=1_000_000, description="of one docking's lossless frames")] = 4000
    views: Annotated[bool, Field(description="what viewers show, at once; else davpc export --to foxglove")] = False
