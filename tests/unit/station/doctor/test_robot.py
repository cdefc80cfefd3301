"""Findings about the robots."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

from common.config import Config
from common.messages import Drives, Health, LeaderState
from follower.camera.calibration_file import StoredCalibration
from station.doctor.findings import (
    Finding,
    ProbeResult,
)
from station.doctor.robot import (
    check_battery,
    check_calibration,
    check_camera_link,
    check_camera_rate,
    check_configuration,
    check_drivers,
    check_drives,
    check_leader,
    check_leds_seen,
    check_processes,
    check_taught,
)
from tests.rigs.station_rig import found

TODAY = date(2026, 5, 1)
FILE = Path("calibration.toml")


def changed(section: Any, **values: Any) -> Any:
    """The same section with other values."""
    return section.model_copy(update=values)


def test_drivers(config: Config) -> None:
    found(check_drivers(config, on_hardware=False), "ok", "camera sim")
    found(check_drivers(config, on_hardware=True), "failed", "camera.driver, follower_can.bus, leader_can.bus")
    shadow = changed(config, follower_can=changed(config.follower_can, shadow=True))
    found(check_drivers(shadow, on_hardware=False), "warning", "shadow")
    readonly = changed(config, follower_can=changed(config.follower_can, readonly=True))
    found(check_drivers(readonly, on_hardware=False), "warning", "readonly")


def test_calibration(config: Config) -> None:
    camera = changed(config.camera, driver="v4l2", calibration="calibration.toml")
    size = {"width_px": camera.width_px, "height_px": camera.height_px}
    good = StoredCalibration(
        camera="042",
        date="2026-04-01",
        rms_px=0.1,
        held_out_px=0.12,
        coverage=0.9,
        views=20,
        lens=camera.lens,
        **size,
    )

    def check(calibration: StoredCalibration, camera_id: str = "v4l2:042", today: date = TODAY) -> Finding:
        return check_calibration(ProbeResult(calibration), camera, camera_id, today, FILE)

    found(check(good), "ok", "30 days old")
    found(check(good, camera_id=""), "ok")
    found(check(good, camera_id="v4l2:043"), "failed", "v4l2:043 instead of 042")
    found(check(good, today=date(2027, 4, 1)), "warning", "365 days")
    found(check(changed(good, width_px=640)), "failed", "instead of 640")
    found(check(changed(good, lens=changed(camera.lens, fx_px=400.0))), "failed", "camera.lens.fx_px")
    found(check(changed(good, date="yesterday")), "failed", "date")
    found(check_calibration(ProbeResult(why="no such file"), camera, "", TODAY, FILE), "failed", "no such file")
    found(check_calibration(ProbeResult(), changed(camera, calibration=""), "", TODAY, FILE), "failed", "names none")
    found(check_calibration(ProbeResult(), config.camera, "", TODAY, FILE), "skipped", "driver sim")


def test_camera(config: Config) -> None:
    at_60_hz = [round(n * 1e9 / 60) for n in range(60)]
    found(check_camera_rate(at_60_hz, 0, 60.0, "here"), "ok", "60.0 Hz of 60")
    found(check_camera_rate(at_60_hz, 3, 60.0, "here"), "warning", "3 lost")
    found(check_camera_rate(at_60_hz, 0, 90.0, "here"), "failed", "60.0 Hz of 90")
    found(check_camera_rate([], 0, 60.0, "here"), "failed", "0 frames")
    usb = changed(config.camera, driver="v4l2")
    found(check_camera_link(ProbeResult(5000.0), usb), "ok", "images need 629")
    found(check_camera_link(ProbeResult(480.0), usb), "failed", "USB 3")
    found(check_camera_link(ProbeResult(why="no camera is on USB here"), usb), "skipped", "no camera")
    found(check_camera_link(ProbeResult(5000.0), config.camera), "skipped", "driver sim")


def test_taught_images_and_leds() -> None:
    found(check_taught(ProbeResult([1, 2])), "ok", "1, 2")
    found(check_taught(ProbeResult(list[int]())), "ok", "geometry")
    found(check_taught(ProbeResult(why="taught with another lens")), "failed", "another lens", "davpc teach 1")
    found(check_leds_seen(4, 4, ""), "ok", "4 of 4")
    found(check_leds_seen(1, 4, "(few_leds)"), "warning", "1 of 4 (few_leds)")


def health(name: str, **values: Any) -> dict[str, Health]:
    return {name: Health(**{"process": name, "ready": True, "steps": 1000, "missed_periods": 0, "malformed": 0,
                            "step_p99_ms": 1.0, **values})}  # fmt: skip


def test_processes() -> None:
    found(check_processes({"leader"}, ["leader"], health("leader")), "ok")
    found(check_processes(set(), ["leader"], {}), "failed", "not running: leader")
    found(check_processes({"leader"}, ["leader"], {}), "failed", "not ready: leader")
    found(check_processes({"leader"}, ["leader"], health("leader", ready=False)), "failed", "not ready: leader")
    found(check_processes({"leader"}, ["leader"], health("leader", malformed=2)), "warning", "leader 2")
    found(check_processes({"leader"}, ["leader"], health("leader", missed_periods=40)), "warning", "40 of 1000")


def drives(**values: Any) -> Drives:
    standing: dict[str, Any] = {
        **dict.fromkeys(("epoch", "measured_ns", "command_sequence", "image_to_can_ns", "gate_interventions"), 0),
        **dict.fromkeys(("wheel_speed_rad_s", "wheel_angle_rad", "grip_torque_n_m", "grip_angle_rad"), (0.0, 0.0)),
        **dict.fromkeys(("joint_torque_n_m", "joint_angle_rad"), (0.0,) * 6),
        **dict.fromkeys(("lift_m", "v_set_m_s", "w_set_rad_s"), 0.0),
        "state": "disarmed",
        "cause": "",
        "stop_inputs_clear": True,
        "battery_v": 26.0,
    }
    return Drives(**{**standing, **values})


def test_drives_and_battery() -> None:
    found(check_drives(drives()), "ok", "disarmed", "stop inputs clear")
    found(check_drives(drives(state="fault", cause="left wheel: overcurrent")), "failed", "overcurrent")
    found(check_drives(drives(stop_inputs_clear=False)), "warning", "stop input")
    found(check_drives(drives(shadow=True)), "warning", "shadow")
    found(check_drives(None), "failed", "nothing")
    found(check_battery(26.0, 24.0), "ok", "26.0 V")
    found(check_battery(23.0, 24.0), "failed", "charge")
    found(check_battery(23.0, 0.0), "ok", "not judged")
    found(check_battery(0.0, 0.0), "failed", "no voltage")


def test_leader() -> None:
    def check(**values: Any) -> Finding:
        standing = {"ready": True, "cause": "", "led_current_a": (1.0,) * 4, "led_fault": False, "guide": "down"}
        standing |= {"lock": "open", "actuator_current_a": 0.0, "queue": 2, "led_setpoint_a": (1.0,) * 4}
        return check_leader(LeaderState(**{**standing, **values}), 0.15)

    found(check(), "ok", "lock open", "2 in the queue")
    found(check(led_current_a=(1.0, 1.0, 0.0, 1.0)), "failed", "0.00")
    found(check(led_fault=True, cause="LED 2 open"), "failed", "LED 2 open")
    found(check(lock="fault"), "failed", "lock fault")
    found(check(ready=False, cause="I/O module silent"), "failed", "I/O module silent")
    found(check(led_derated=True), "warning", "derated")
    found(check(queue=None), "warning", "davpc lock count")
    found(check_leader(None, 0.15), "failed", "nothing of it")


def test_configuration(config: Config) -> None:
    found(check_configuration(FILE, ProbeResult(config)), "ok", "calibration.toml")
    found(
        check_configuration(FILE, ProbeResult(why="robots.toml: camera.rate_hz: too much")),
        "failed",
        "camera.rate_hz",
    )
