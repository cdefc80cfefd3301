"""Checks of a robot: configuration, calibration, camera, LEDs, processes, drives, battery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path

from common.config import CameraConfig, Config
from common.errors import ConfigError
from common.messages import DockingState, Drives, Health, LeaderState
from follower.camera.calibration_file import StoredCalibration, age_days
from station.calibrate.lens_file import differences
from station.doctor.findings import Finding, ProbeResult, failed, ok, skipped, warning

OLD_DAYS = 180
# frame sources that stand in for a camera
WITHOUT_DEVICE = ("sim", "replay")
_BITS_PER_PIXEL = 8
# share of a link's nominal speed that images can use: USB 3 has 8b/10b coding and protocol, USB 2 the like
_LINK_SHARE = 0.75


def check_configuration(path: Path, probed: ProbeResult[Config]) -> Finding:
    """Whether the file can be used."""
    if probed.value is None:
        return failed("configuration", probed.why, "correct it; deploy/config/robots.toml explains each key")
    return ok("configuration", f"{path}")


def check_drivers(config: Config, on_hardware: bool) -> Finding:
    """Whether camera and buses are real, on a computer that was installed for a real robot."""
    stand_ins = ["camera.driver"] if config.camera.driver in WITHOUT_DEVICE else []
    buses = (("follower_can", config.follower_can.bus), ("leader_can", config.leader_can.bus))
    stand_ins += [f"{name}.bus" for name, bus in buses if bus.interface != "socketcan"]
    text = f"camera {config.camera.driver}, buses {', '.join(bus.interface for _, bus in buses)}"
    if on_hardware and stand_ins:
        return failed("drivers", f"simulated on a robot: {', '.join(stand_ins)}", "name the real ones")
    for mode in ("shadow", "readonly"):
        if getattr(config.follower_can, mode):
            return warning(
                "drivers", f"{text}; follower_can.{mode}", "no drive is ever enabled: set it false to drive"
            )
    return ok("drivers", text)


def check_calibration(
    probed: ProbeResult[StoredCalibration], camera: CameraConfig, camera_id: str, today: date, path: Path
) -> Finding:
    """The lens in the configuration against the calibration it came from: size, lens, camera, age.

    Args:
        probed: the calibration's file.
        camera: the configured one.
        camera_id: what the camera calls itself, as ``driver:serial``; "" if it was not asked.
        today: of the wall clock.
        path: of the calibration.
    """
    again = "davpc calibrate camera --live, then its table lens into camera.lens"
    if camera.driver in WITHOUT_DEVICE:
        return skipped("calibration", f"driver {camera.driver} has no lens but the configured one")
    if not camera.calibration:
        return failed("calibration", "camera.calibration names none", again)
    if probed.value is None:
        return failed("calibration", probed.why, again)
    calibration = probed.value
    wrong = differences(calibration, camera)
    if camera_id and not _is_of(calibration.camera, camera_id):
        wrong.append(f"camera {camera_id} instead of {calibration.camera}")
    if wrong:
        return failed("calibration", f"{path}: {'; '.join(wrong)}", again)
    try:
        days = age_days(calibration, today, path)
    except ConfigError as error:
        return failed("calibration", str(error), again)
    text = f"{days} days old, {calibration.held_out_px:.2f} px, camera {calibration.camera}"
    if days > OLD_DAYS or days < 0:
        return warning("calibration", text, again)
    return ok("calibration", text)


def _is_of(calibrated: str, camera_id: str) -> bool:
    """Whether a calibration's camera, a serial number or as the driver gives it, is this one."""
    return calibrated in (camera_id, camera_id.partition(":")[2])


def check_camera_rate(stamps_ns: Sequence[int], missing: int, wanted_hz: float, source: str) -> Finding:
    """Frames as they came.

    Args:
        stamps_ns: when each was captured.
        missing: numbers of frames that were left out between them.
        wanted_hz: configured.
        source: where they came from.
    """
    if len(stamps_ns) < 2:
        return failed(
            "camera rate", f"{len(stamps_ns)} frames {source}", "cable, power, camera.driver, camera.device?"
        )
    rate_hz = (len(stamps_ns) - 1) * 1e9 / max(stamps_ns[-1] - stamps_ns[0], 1)
    text = f"{rate_hz:.1f} Hz of {wanted_hz:g} {source}"
    if not 0.9 * wanted_hz <= rate_hz <= 1.1 * wanted_hz:
        return failed("camera rate", text, "camera.rate_hz, exposure, the link's speed, a busy computer?")
    if missing:
        return warning("camera rate", f"{text}, {missing} lost", "a busy computer or link: davpc processes, top")
    return ok("camera rate", text)


def check_camera_link(speed: ProbeResult[float], camera: CameraConfig) -> Finding:
    """USB speed in Mbit/s against what the images need."""
    if camera.driver in WITHOUT_DEVICE:
        return skipped("camera link", f"driver {camera.driver} has none")
    if speed.value is None:
        return skipped("camera link", speed.why)
    need = camera.width_px * camera.height_px * camera.rate_hz * _BITS_PER_PIXEL / 1e6
    text = f"{speed.value:g} Mbit/s, images need {need:.0f}"
    if need > _LINK_SHARE * speed.value:
        return failed("camera link", text, "plug it into USB 3 with a USB 3 cable, no hub between")
    return ok("camera link", text)


def check_taught(probed: ProbeResult[list[int]]) -> Finding:
    """Desired images, by trolley: their hash of lens and mounting, and their array, are the configured ones."""
    if probed.value is None:
        return failed("taught images", probed.why, "stand at the docked pose: davpc teach 1")
    if not probed.value:
        return ok("taught images", "none configured: geometry gives them")
    return ok("taught images", f"for trolley {', '.join(map(str, probed.value))}, of this lens and mounting")


def check_processes(alive: set[str], expected: Sequence[str], health: Mapping[str, Health]) -> Finding:
    """Which processes are alive, and in what state; gateways may be absent on one machine."""
    absent = [name for name in expected if name not in alive]
    if absent:
        return failed("processes", f"not running: {', '.join(absent)}", "their logs: journalctl -u davpc-NAME")
    unwell = [name for name, state in health.items() if name in alive and not state.ready]
    silent = [name for name in expected if name not in health]
    if unwell or silent:
        return failed("processes", f"not ready: {', '.join([*unwell, *silent])}", "see their logs")
    malformed = [f"{name} {state.malformed}" for name, state in health.items() if state.malformed]
    if malformed:
        return warning("processes", f"malformed messages: {', '.join(malformed)}", "are all of the same version?")
    missed = [
        f"{name} {state.missed_periods} of {state.steps}"
        for name, state in health.items()
        if state.missed_periods > 0.01 * state.steps + 5
    ]
    if missed:
        return warning("processes", f"missed periods: {', '.join(missed)}", "a busy computer; see real time")
    return ok("processes", f"{len(alive)} alive, {len(expected)} expected")


def check_drives(drives: Drives | None) -> Finding:
    """What the bridge reports of the drives; it reads identities and watchdogs back before it leaves ``starting``."""
    if drives is None:
        return failed("drives", "the bridge publishes nothing", "journalctl -u davpc-follower-can-bridge")
    text = f"{drives.state}" + (f": {drives.cause}" if drives.cause else "")
    if drives.state in ("starting", "fault"):
        return failed("drives", text, "power, bus, davpc can scan; after a look at the robot: davpc dock reset")
    if not drives.stop_inputs_clear:
        return warning("drives", f"{text}; a stop input is active or silent", "release emergency and protective stop")
    if drives.shadow:
        return warning(
            "drives",
            f"{text}; in shadow or read-only",
            "no drive is ever enabled: follower_can.shadow = false, readonly = false to drive",
        )
    return ok("drives", f"{text}; stop inputs clear; identities and watchdogs were read back when the bus opened")


def check_battery(volts: float | None, low_v: float) -> Finding:
    """Against ``base.battery_low_v``; 0 V is no measurement."""
    if volts is None:
        return failed("battery", "what is read can be no battery's voltage", "wire of analogue input 1, its scale")
    text = f"{volts:.1f} V"
    if volts <= 0:
        return failed("battery", "no voltage is measured", "analogue input 1 of the Follower's I/O module")
    if not low_v:
        return ok("battery", f"{text}; base.battery_low_v is 0: not judged")
    if volts < low_v:
        return failed("battery", f"{text}, low is {low_v:g}", "charge it")
    return ok("battery", f"{text}, low is {low_v:g}")


def check_leds_seen(seen: int, total: int, note: str) -> Finding:
    """LEDs that the camera sees. Only the operator knows whether the array is in view: no failure."""
    text = f"{seen} of {total} {note}".strip()
    if seen < total:
        return warning("LEDs seen", text, "is the array in view? davpc camera focus, davpc camera snapshot")
    return ok("LEDs seen", text)


def seen_by_estimator(state: DockingState, total: int) -> Finding:
    """LEDs in the newest docking state."""
    return check_leds_seen(state.leds_seen, total, "" if state.cause == "ok" else f"({state.cause})")


def check_leader(state: LeaderState | None, tolerance_a: float) -> Finding:
    """The Leader's array, guide and lock, as it reports them itself."""
    if state is None:
        return failed("Leader", "nothing of it is received", "does it run? see link, journalctl -u davpc-leader")
    currents = ", ".join(f"{current:.2f}" for current in state.led_current_a)
    text = f"LEDs {currents} A, guide {state.guide}, lock {state.lock}"
    pairs = zip(state.led_current_a, state.led_setpoint_a, strict=False)
    if state.led_fault or any(abs(drawn - commanded) > tolerance_a for drawn, commanded in pairs):
        return failed("Leader", f"{text}: {state.cause or 'LED current'}", "LED driver and wiring: davpc led status")
    if not state.ready or state.lock == "fault":
        return failed("Leader", f"{text}: {state.cause or 'not ready'}", "look at it; davpc lock status")
    if state.led_derated:
        return warning("Leader", f"{text}; LEDs are derated", "let the array cool")
    if state.queue is None:
        return warning("Leader", f"{text}; its queue is not known", "count the trolleys: davpc lock count")
    return ok("Leader", f"{text}, {state.queue} in the queue")
