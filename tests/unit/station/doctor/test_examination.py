"""``davpc doctor``: each check tells well from ill, a probe that fails or hangs is a line, the report is for programs
too."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from common.config import Config, LimitsConfig
from common.errors import ConfigError, DeviceError
from common.messages import Drives, GatewayState, Health, LeaderState
from common.processes import PROCESSES
from gateway.access import robot_access, rules_digest
from station.calibrate.lens_file import StoredCalibration
from station.doctor import probes as doctor_probes
from station.doctor.examination import Visit, default_robots
from station.doctor.findings import (
    Finding,
    Seen,
    Status,
    as_table,
    failed,
    is_well,
    look,
    ok,
    skipped,
    summary,
    warning,
)
from station.doctor.machine import (
    UnitState,
    check_clock,
    check_disk,
    check_packages,
    check_python,
    check_realtime,
    check_units,
    expected_units,
    locked_versions,
)
from station.doctor.network import check_access, check_certificate, check_link
from station.doctor.probes import parse_units, process_of
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
    check_limits,
    check_processes,
    check_taught,
)

LOCK = "numpy==2.2.1 ; python_version < '3.12' \\\n    --hash=sha256:00\nnumpy==2.3.0\nPy_Yaml[x]==6.0\n"
DAY_S = 86_400.0
TODAY = date(2026, 5, 1)
FILE = Path("calibration.toml")


def told(finding: Finding, status: Status, *words: str) -> None:
    """The finding is of this status, and says these words."""
    assert finding.status == status, finding
    for word in words:
        assert word in finding.line(), finding
    if status in ("warning", "failed"):
        assert finding.remedy, "a complaint says what to do"


# -- the computer


def test_python_and_packages() -> None:
    told(check_python((3, 11, 2), "0.1.0", "/opt"), "ok", "3.11.2", "0.1.0")
    told(check_python((3, 10, 9), "0.1.0", "/opt"), "failed", "3.11 or newer")
    assert locked_versions(LOCK) == {"numpy": {"2.2.1", "2.3.0"}, "py-yaml": {"6.0"}}
    told(check_packages(LOCK, {"numpy": "2.3.0", "other": "1"}, ["numpy"]), "ok", "1 as locked")
    told(check_packages(LOCK, {"numpy": "2.4.0"}, ["numpy"]), "failed", "numpy 2.4.0 instead of 2.2.1 or 2.3.0")
    told(check_packages(LOCK, {}, ["numpy"]), "failed", "missing: numpy")
    told(check_packages(None, {"numpy": "2.3.0"}, ["numpy"]), "skipped", "no lock file")


def test_disk() -> None:
    told(check_disk("disk", "/var", 5_000_000_000, 200, 1000), "ok", "5000 MB")
    told(check_disk("disk", "/var", 900_000_000, 200, 1000), "warning", "900 MB free in /var")
    told(check_disk("disk", "/var", 100_000_000, 200, 1000), "failed", "at least 200 MB")


def test_clock() -> None:
    told(check_clock(True, 0.001, 2e9, 1e9), "ok", "synchronised")
    told(check_clock(None, 0.0, 2e9, 1e9), "ok", "cannot tell")
    told(check_clock(False, 0.0, 2e9, 1e9), "warning", "not synchronised")
    told(check_clock(True, -3600.0, 2e9, 1e9), "warning", "stepped by -3600.00 s")
    told(check_clock(True, 0.0, 1e9, 2e9), "failed", "before davpc's own files")


def test_real_time() -> None:
    wanted = {"leader": 40, "follower-arms": 40}
    told(check_realtime({"leader": 40}, wanted, False, True), "ok", "1 processes")
    told(check_realtime({"leader": None}, wanted, True, True), "failed", "leader")
    told(check_realtime({"leader": 39}, wanted, True, False), "warning", "leader", "ulimit")
    told(check_realtime({}, wanted, False, True), "ok", "units")
    told(check_realtime({}, wanted, True, False), "ok", "allowed")
    told(check_realtime({}, wanted, False, False), "warning", "not allowed")


def units(**changed: UnitState) -> dict[str, UnitState]:
    names = expected_units([entry for entry in PROCESSES if entry.robot == "leader"])
    states = {name: UnitState("loaded", "active") for name in [*names, "davpc-leader.target"]}
    states["davpc-safe.target"] = UnitState("loaded", "inactive")
    renamed = {"davpc-" + name.replace("__", ".").replace("_", "-"): state for name, state in changed.items()}
    return {**states, **renamed}


def test_units() -> None:
    safe = "davpc-safe.target"

    def check(**changed: UnitState) -> Finding:
        return check_units("leader", units(**changed), safe)

    told(check(), "ok", "2 run")
    told(check(leader__target=UnitState("loaded", "inactive")), "ok", "stopped")
    told(check(leader__service=UnitState("loaded", "active", restarts=2)), "warning", "davpc-leader.service ×2")
    told(check(leader__service=UnitState("loaded", "failed", "exit-code")), "failed", "exit-code")
    told(check(leader__service=UnitState("loaded", "inactive")), "failed", "not running: davpc-leader.service")
    told(check(leader_gateway__service=UnitState("loaded", "inactive")), "warning", "certificates")
    told(check(safe__target=UnitState("loaded", "active")), "failed", "safe stop")
    told(check(leader__target=UnitState("not-found", "inactive")), "skipped", "not installed")
    told(check_units("leader", None, safe), "skipped", "systemd does not run here")


def test_systemctl_is_understood() -> None:
    told_by = "Id=a.service\nLoadState=loaded\nActiveState=active\nResult=success\nNRestarts=3\n\nId=b.target\n"
    told_by += "LoadState=not-found\nActiveState=inactive\nNRestarts=\n"
    assert parse_units(told_by) == {
        "a.service": UnitState("loaded", "active", "success", 3),
        "b.target": UnitState("not-found", "inactive", "", 0),
    }


def test_a_service_manager_that_does_not_answer_is_not_taken_for_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_probes, "_SYSTEMD", tmp_path)
    monkeypatch.setattr(doctor_probes, "_output", lambda _: None)
    findings = {found.check: found for found in Visit(("leader",), tmp_path, tmp_path / "none.toml").findings()}
    told(findings["units leader"], "warning", "systemctl did not answer")
    monkeypatch.setattr(doctor_probes, "_SYSTEMD", tmp_path / "none")
    findings = {found.check: found for found in Visit(("leader",), tmp_path, tmp_path / "none.toml").findings()}
    told(findings["units leader"], "skipped", "systemd does not run here")


def test_command_lines_are_understood() -> None:
    runtime = Path("/run/davpc")
    assert process_of(["python", "davpc", "run", "leader", ""], runtime) == "leader"
    assert process_of(["davpc", "run", "leader", "--runtime", "/elsewhere"], runtime) == ""
    assert process_of(["davpc", "run", "leader", "--runtime", "/elsewhere"], Path("/elsewhere")) == "leader"
    assert process_of(["npm", "run", "test", ""], runtime) == ""
    assert process_of(["run"], runtime) == ""


# -- the robot


def test_configuration_and_limits(config: Config) -> None:
    told(check_configuration(FILE, Seen(config)), "ok", "calibration.toml")
    told(check_configuration(FILE, Seen(why="robots.toml: camera.rate_hz: too much")), "failed", "camera.rate_hz")
    told(check_limits(config.limits), "ok", "v 0.5 of 0.6 m/s")
    beyond = LimitsConfig.model_construct(**{**config.limits.model_dump(), "v_max_m_s": 0.7})
    told(check_limits(beyond), "failed", "v 0.7 > 0.6 m/s")


def changed(section: Any, **values: Any) -> Any:
    """The same section with other values."""
    return section.model_copy(update=values)


def test_drivers(config: Config) -> None:
    told(check_drivers(config, on_hardware=False), "ok", "camera sim")
    told(check_drivers(config, on_hardware=True), "failed", "camera.driver, follower_can.bus, leader_can.bus")
    shadow = changed(config, follower_can=changed(config.follower_can, shadow=True))
    told(check_drivers(shadow, on_hardware=False), "warning", "shadow")
    readonly = changed(config, follower_can=changed(config.follower_can, readonly=True))
    told(check_drivers(readonly, on_hardware=False), "warning", "readonly")


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
        return check_calibration(Seen(calibration), camera, camera_id, today, FILE)

    told(check(good), "ok", "30 days old")
    told(check(good, camera_id=""), "ok")
    told(check(good, camera_id="v4l2:043"), "failed", "v4l2:043 instead of 042")
    told(check(good, today=date(2027, 4, 1)), "warning", "365 days")
    told(check(changed(good, width_px=640)), "failed", "instead of 640")
    told(check(changed(good, lens=changed(camera.lens, fx_px=400.0))), "failed", "camera.lens.fx_px")
    told(check(changed(good, date="yesterday")), "failed", "date")
    told(check_calibration(Seen(why="no such file"), camera, "", TODAY, FILE), "failed", "no such file")
    told(check_calibration(Seen(), changed(camera, calibration=""), "", TODAY, FILE), "failed", "names none")
    told(check_calibration(Seen(), config.camera, "", TODAY, FILE), "skipped", "driver sim")


def test_camera(config: Config) -> None:
    at_60_hz = [round(n * 1e9 / 60) for n in range(60)]
    told(check_camera_rate(at_60_hz, 0, 60.0, "here"), "ok", "60.0 Hz of 60")
    told(check_camera_rate(at_60_hz, 3, 60.0, "here"), "warning", "3 lost")
    told(check_camera_rate(at_60_hz, 0, 90.0, "here"), "failed", "60.0 Hz of 90")
    told(check_camera_rate([], 0, 60.0, "here"), "failed", "0 frames")
    usb = changed(config.camera, driver="v4l2")
    told(check_camera_link(Seen(5000.0), usb), "ok", "images need 629")
    told(check_camera_link(Seen(480.0), usb), "failed", "USB 3")
    told(check_camera_link(Seen(why="no camera is on USB here"), usb), "skipped", "no camera")
    told(check_camera_link(Seen(5000.0), config.camera), "skipped", "driver sim")


def test_taught_images_and_leds() -> None:
    told(check_taught(Seen([1, 2])), "ok", "1, 2")
    told(check_taught(Seen(list[int]())), "ok", "geometry")
    told(check_taught(Seen(why="taught with another lens")), "failed", "another lens", "davpc teach 1")
    told(check_leds_seen(4, 4, ""), "ok", "4 of 4")
    told(check_leds_seen(1, 4, "(few_leds)"), "warning", "1 of 4 (few_leds)")


def health(name: str, **values: Any) -> dict[str, Health]:
    return {name: Health(**{"process": name, "ready": True, "steps": 1000, "missed_periods": 0, "malformed": 0,
                            "step_p99_ms": 1.0, **values})}  # fmt: skip


def test_processes() -> None:
    told(check_processes({"leader"}, ["leader"], health("leader")), "ok")
    told(check_processes(set(), ["leader"], {}), "failed", "not running: leader")
    told(check_processes({"leader"}, ["leader"], {}), "failed", "not ready: leader")
    told(check_processes({"leader"}, ["leader"], health("leader", ready=False)), "failed", "not ready: leader")
    told(check_processes({"leader"}, ["leader"], health("leader", malformed=2)), "warning", "leader 2")
    told(check_processes({"leader"}, ["leader"], health("leader", missed_periods=40)), "warning", "40 of 1000")


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
    told(check_drives(drives()), "ok", "disarmed", "stop inputs clear")
    told(check_drives(drives(state="fault", cause="left wheel: overcurrent")), "failed", "overcurrent")
    told(check_drives(drives(stop_inputs_clear=False)), "warning", "stop input")
    told(check_drives(drives(shadow=True)), "warning", "shadow")
    told(check_drives(None), "failed", "nothing")
    told(check_battery(26.0, 24.0), "ok", "26.0 V")
    told(check_battery(23.0, 24.0), "failed", "charge")
    told(check_battery(23.0, 0.0), "ok", "not judged")
    told(check_battery(0.0, 0.0), "failed", "no voltage")


def test_leader() -> None:
    def check(**values: Any) -> Finding:
        standing = {"ready": True, "cause": "", "led_current_a": (1.0,) * 4, "led_fault": False, "guide": "down"}
        standing |= {"lock": "open", "actuator_current_a": 0.0, "queue": 2, "led_setpoint_a": (1.0,) * 4}
        return check_leader(LeaderState(**{**standing, **values}), 0.15)

    told(check(), "ok", "lock open", "2 in the queue")
    told(check(led_current_a=(1.0, 1.0, 0.0, 1.0)), "failed", "0.00")
    told(check(led_fault=True, cause="LED 2 open"), "failed", "LED 2 open")
    told(check(lock="fault"), "failed", "lock fault")
    told(check(ready=False, cause="I/O module silent"), "failed", "I/O module silent")
    told(check(led_derated=True), "warning", "derated")
    told(check(queue=None), "warning", "davpc lock count")
    told(check_leader(None, 0.15), "failed", "not heard")


# -- the network


def test_certificates() -> None:
    told(check_certificate("follower", Seen(200 * DAY_S)), "ok", "200.0 days")
    told(check_certificate("follower", Seen(20 * DAY_S)), "warning", "deploy/pki.sh renew follower")
    told(check_certificate("follower", Seen(0.5 * DAY_S)), "failed", "0.5 days")
    told(check_certificate("follower", Seen(why="follower.key: others may read it")), "failed", "others may read")


def test_access_rules(config: Config) -> None:
    generated = robot_access(config.network, "follower")

    def check(rules: dict[str, Any], running: GatewayState | None) -> Finding:
        return check_access("follower", rules, config.network.namespace, running)

    told(check(generated, None), "ok", "no gateway runs")
    told(check(generated, GatewayState(True, 1e6, rules_digest(generated))), "ok", "as the gateway works")
    other = robot_access(config.network.model_copy(update={"namespace": "elsewhere"}), "follower")
    told(check(generated, GatewayState(True, 1e6, rules_digest(other))), "failed", "restart davpc-follower-gateway")
    leaking = copy.deepcopy(generated)
    leaking["rules"].append({"id": "leak", "key_exprs": ["davpc/follower/motion/command"]})
    policies = {policy["subjects"][0]: policy for policy in leaking["policies"]}
    policies["neighbour"]["rules"].append("leak")
    told(check(leaking, None), "failed", "davpc/follower/motion/command")
    told(check({**generated, "default_permission": "allow"}, None), "failed", "deny by default")
    told(check({**generated, "enabled": False}, None), "failed", "not enabled")


def test_link() -> None:
    told(check_link("follower", GatewayState(True, 1e6, "")), "ok")
    told(check_link("follower", GatewayState(False, 1e6, "")), "warning", "not heard")
    told(check_link("follower", None), "skipped")


# -- probes and report


def raising(error: Exception) -> Callable[[], int]:
    def probe() -> int:
        raise error

    return probe


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ConfigError("robots.toml: no"), "robots.toml: no"),
        (DeviceError("camera: no"), "camera: no"),
        (PermissionError(13, "Permission denied", "/x"), "/x: Permission denied"),
        (KeyError("surprise"), "KeyError: 'surprise'"),
        (ValueError("two\nlines"), "ValueError: two"),
    ],
)
def test_a_probe_that_fails_is_a_line(error: Exception, line: str) -> None:
    assert look(raising(error), 10.0) == Seen(why=line)


def test_a_probe_that_hangs_is_left_behind() -> None:
    never = threading.Event()
    assert look(never.wait, 0.05).why == "no answer within 0 s"
    never.set()
    assert look(lambda: 3, 10.0) == Seen(3)


def test_the_report() -> None:
    findings = [ok("a", "well"), warning("b", "old", "renew"), skipped("c", "there is none")]
    assert is_well(findings)
    assert summary(findings) == "1 warning, 1 ok, 1 skipped"
    assert findings[1].line().split() == ["warning", "b", "old", "→", "renew"]
    findings.append(failed("d", "broken", "mend"))
    assert not is_well(findings)
    table = as_table(findings)
    assert table["ok"] is False
    assert table["findings"][3] == {"check": "d", "status": "failed", "seen": "broken", "remedy": "mend"}


def test_whose_parts() -> None:
    assert default_robots(None) == ("follower", "leader")
    assert default_robots(("leader", "hardware")) == ("leader",)
    assert default_robots(("leader", "simulated")) == ("follower", "leader")
