"""What keeps the robot from arming although nothing is broken: another camera's lens, a certificate about to expire.

Both are judged when a docking is asked for; one under way is finished.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Final

from common.config import CameraConfig
from common.errors import ConfigError
from common.messages import GatewayState
from follower.camera.calibration_file import age_days, stored, unlike

LEAST_CERTIFICATE_S: Final = 24 * 3600.0


def certificate_unfit(gateway: GatewayState | None) -> str:
    """Why no docking may begin with this gateway; empty without one (docs/safety.md S45)."""
    if gateway is None or gateway.certificate_left_s > LEAST_CERTIFICATE_S:
        return ""
    left_h = max(gateway.certificate_left_s, 0.0) / 3600.0
    return f"the certificate expires in {left_h:.1f} h: deploy/pki.sh renew follower"


class CalibrationWatch:
    """Whether the lens in use is that of the camera in use: docs/safety.md S32.

    Args:
        camera: the configured camera; without ``calibration`` nothing is judged.
        config_path: the configuration, beside which the calibration lies.
        today: by the wall clock, when the process began.
    """

    def __init__(self, camera: CameraConfig, config_path: Path, today: date) -> None:
        self._camera = ""
        self._fault = ""
        if camera.calibration:
            try:
                self._fault = self._read(camera, config_path.parent / camera.calibration, today)
            except ConfigError as error:
                self._fault = f"camera.calibration: {error}"

    def unfit(self, camera_id: str | None) -> str:
        """Why nothing may be armed; empty if the calibration fits, or if none is configured.

        Args:
            camera_id: serial number in the newest frame, None before the first.
        """
        if self._fault or not self._camera or camera_id is None or camera_id == self._camera:
            return self._fault
        return f"camera.calibration is of camera {self._camera}, frames come from {camera_id}: calibrate this one"

    def _read(self, camera: CameraConfig, path: Path, today: date) -> str:
        calibration = stored(path)
        self._camera = calibration.camera
        differences = unlike(calibration, camera)
        if differences:
            return f"camera.calibration: {path}: {differences[0]}"
        age = age_days(calibration, today, path)
        if age > camera.calibration_max_days:
            return f"camera.calibration: {path}: {age} days old, more than {camera.calibration_max_days}: repeat it"
        if age < 0:
            return f"camera.calibration: {path}: made on {calibration.date}, which is to come: is the clock right?"
        return ""
