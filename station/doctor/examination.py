"""One examination of ``davpc doctor``: which probes run, and which check judges what they found."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property, partial
from importlib import metadata
from pathlib import Path

from common.channels import DOCKING_STATE, DRIVES, FOLLOWER_GATEWAY, LEADER_GATEWAY, LEADER_STATE
from common.config import BusConfig, Config, load_config
from common.processes import ONE_MACHINE, PROCESSES
from follower.camera.calibration_file import StoredCalibration, stored
from follower.model.taught import taught_geometry
from gateway.access import Robot, robot_access
from gateway.credentials import check_credentials, credentials_folder
from station.commission.eds_check import missing_objects
from station.doctor import can as doctor_can
from station.doctor import machine as doctor_machine
from station.doctor import network as doctor_network
from station.doctor import probes as doctor_probes
from station.doctor import robot as doctor_robot
from station.doctor.bus import RobotReport, listen
from station.doctor.findings import Finding, ProbeResult, run_probe, skipped, warning

_PROBE_S = 8.0
_BUS_S = 20.0
_LISTEN_S = 1.6
_KEPT = Path("/var/lib/davpc")
_SAFE = "davpc-safe.target"


@dataclass
class Examination:
    """What does not depend on the configuration, and after it what does.

    Attributes:
        robots: whose parts to look at.
        runtime: folder of the running robot's sockets.
        path, overrides: of the configuration.
        devices: open camera and CAN buses that no process of ours has open.
        hardware: this computer was installed for a real robot.
    """

    robots: Sequence[Robot]
    runtime: Path
    path: Path
    overrides: Sequence[str] = ()
    devices: bool = True
    hardware: bool = False
    _began_s: float = field(default_factory=doctor_probes.clock_offset_s)

    def findings(self) -> Iterator[Finding]:
        """All of them, as they come."""
        yield from self._software()
        probed = run_probe(partial(load_config, self.path, self.overrides), _PROBE_S)
        yield doctor_robot.check_configuration(self.path, probed)
        if probed.value is not None:
            yield from RobotExamination(self, probed.value).findings()
        yield from self._computer()

    def _software(self) -> Iterator[Finding]:
        version = (sys.version_info.major, sys.version_info.minor, sys.version_info.micro)
        place = str(Path(__file__).resolve().parents[2])
        yield doctor_machine.check_python(version, metadata.version("davpc"), place)
        installed = run_probe(doctor_probes.installed_packages, _PROBE_S).value or {}
        yield doctor_machine.check_packages(doctor_probes.lock_text(), installed, doctor_probes.needed_packages())

    def _computer(self) -> Iterator[Finding]:
        for check, path, least_mb, comfortable_mb in (
            ("disk", _KEPT if _KEPT.is_dir() else Path.home(), 200, 1000),
            ("memory for frames", self.runtime if self.runtime.is_dir() else Path("/run"), 16, 32),
        ):
            usage = run_probe(partial(shutil.disk_usage, path), _PROBE_S)
            if usage.value is None:
                yield skipped(check, usage.why)
            else:
                yield doctor_machine.check_disk(check, str(path), usage.value.free, least_mb, comfortable_mb)
        probed = run_probe(partial(doctor_probes.unit_states, self._units()), _PROBE_S)
        yield self._realtime(any(state.load == "loaded" for state in (probed.value or {}).values()))
        for robot in self.robots:
            if probed.why:
                yield warning(f"units {robot}", probed.why, "a busy computer? look again: systemctl status 'davpc-*'")
            else:
                yield doctor_machine.check_units(robot, self._of(robot, probed.value), _SAFE)
        stepped_s = doctor_probes.clock_offset_s() - self._began_s
        synchronised = run_probe(doctor_probes.clock_synchronised, _PROBE_S).value
        yield doctor_machine.check_clock(synchronised, stepped_s, time.time(), doctor_probes.newest_file_s())

    def _units(self) -> list[str]:
        services = doctor_machine.expected_units([e for e in PROCESSES if e.robot in self.robots])
        return [*services, *(f"davpc-{robot}.target" for robot in self.robots), _SAFE]

    def _of(
        self, robot: Robot, states: dict[str, doctor_machine.UnitState] | None
    ) -> dict[str, doctor_machine.UnitState] | None:
        """States that concern one robot."""
        if states is None:
            return None
        return {name: s for name, s in states.items() if name == _SAFE or name.startswith(f"davpc-{robot}")}

    def _realtime(self, installed: bool) -> Finding:
        wanted = {entry.name: entry.priority for entry in PROCESSES if entry.robot in self.robots}
        running = run_probe(partial(doctor_probes.fifo_priorities, self.runtime, list(wanted)), _PROBE_S).value or {}
        return doctor_machine.check_realtime(running, wanted, doctor_probes.realtime_allowed(), installed)


@dataclass
class RobotExamination:
    """What depends on a configuration that can be read."""

    examination: Examination
    config: Config

    @cached_property
    def listened(self) -> ProbeResult[RobotReport]:
        """What the running robot sent."""
        space = self.config.network.namespace
        return run_probe(partial(listen, self.examination.runtime, space, _LISTEN_S), _PROBE_S)

    @property
    def report(self) -> RobotReport:
        """The same, empty where it could not be listened to."""
        return self.listened.value or RobotReport()

    def findings(self) -> Iterator[Finding]:
        """All, robot by robot."""
        yield doctor_robot.check_drivers(self.config, self.examination.hardware)
        yield self._processes()
        if "follower" in self.examination.robots:
            yield from self._camera()
            yield from self._drives()
        yield from self._leader()
        for robot in self.examination.robots:
            yield from self._bus(robot)
        for robot in self.examination.robots:
            yield from self._network(robot)

    def _processes(self) -> Finding:
        if self.listened.value is None:
            return skipped("processes", self.listened.why)
        expected = [entry.name for entry in ONE_MACHINE if entry.robot in self.examination.robots]
        if not self.report.alive & set(expected):
            return self._nothing_runs()
        health = {name: found for name, found in self.report.health().items() if name in expected}
        return doctor_robot.check_processes(set(self.report.alive), expected, health)

    def _nothing_runs(self) -> Finding:
        text = f"davpc does not run in {self.examination.runtime}"
        if not self.examination.hardware:
            return skipped("processes", text)
        targets = " ".join(f"davpc-{robot}.target" for robot in self.examination.robots)
        return warning("processes", text, f"to look at the running robot: sudo systemctl start {targets}")

    def _camera(self) -> Iterator[Finding]:
        camera, total = self.config.camera, len(self.config.leds.points)
        camera_id = ""
        if "follower-camera" in self.report.alive:
            frames, state = self.report.frames, self.report.of(DOCKING_STATE)
            camera_id = frames[-1].camera_id if frames else ""
            missing = frames[-1].sequence - frames[0].sequence + 1 - len(frames) if frames else 0
            stamps = [frame.capture_ns for frame in frames]
            yield doctor_robot.check_camera_rate(
                stamps, missing, camera.rate_hz, f"from {camera_id or 'the process'}"
            )
            yield (
                skipped("LEDs seen", "the estimator sends nothing")
                if state is None
                else doctor_robot.seen_by_estimator(state, total)
            )
        elif (
            not self.examination.devices
            or camera.driver in doctor_robot.WITHOUT_DEVICE
            or self.listened.value is None
        ):
            for check in ("camera rate", "LEDs seen"):
                yield skipped(check, "the camera's process does not run, or nothing of it is received")
        else:
            probe = partial(doctor_probes.grab, self.config, self.examination.path, self.examination.runtime, 1.0)
            grabbed = run_probe(probe, _PROBE_S)
            got = grabbed.value or doctor_probes.CameraSample((), "", 0)
            camera_id = got.camera_id
            source = f"from {camera_id}, opened for this" if camera_id else grabbed.why
            yield doctor_robot.check_camera_rate(got.stamps_ns, 0, camera.rate_hz, source)
            yield doctor_robot.check_leds_seen(min(got.spots, total), total, f"({got.spots} spots)")
        probe_link = partial(doctor_probes.usb_speed_mbit_s, camera)
        yield doctor_robot.check_camera_link(run_probe(probe_link, _PROBE_S), camera)
        path = self.examination.path.parent / camera.calibration
        probed = (
            run_probe(partial(stored, path), _PROBE_S) if camera.calibration else ProbeResult[StoredCalibration]()
        )
        today = datetime.now(UTC).date()
        yield doctor_robot.check_calibration(probed, camera, camera_id, today, path)
        yield self._taught()

    def _taught(self) -> Finding:
        def trolleys() -> list[int]:
            found = taught_geometry(self.config, self.examination.path)
            return [] if found is None else sorted(found.goals)

        return doctor_robot.check_taught(run_probe(trolleys, _PROBE_S))

    def _drives(self) -> Iterator[Finding]:
        if "follower-can-bridge" not in self.report.alive:
            for check in ("drives", "battery"):
                yield skipped(check, "the CAN bridge does not run, or nothing of it is received")
            return
        drives = self.report.of(DRIVES)
        yield doctor_robot.check_drives(drives)
        if drives is not None:
            yield doctor_robot.check_battery(drives.battery_v, self.config.base.battery_low_v)

    def _leader(self) -> Iterator[Finding]:
        state = self.report.of(LEADER_STATE)
        here = "leader" in self.examination.robots and "leader" in self.report.alive
        if state is None and not here:
            yield skipped("Leader", "it does not run here, and nothing of it is received")
            return
        yield doctor_robot.check_leader(state, self.config.leader.led_current_tolerance_a)

    def _bus(self, robot: Robot) -> Iterator[Finding]:
        follower = robot == "follower"
        if robot == self.examination.robots[0]:
            yield doctor_can.check_files(
                run_probe(partial(missing_objects, self.config, self.examination.path), _PROBE_S)
            )
        can = self.config.follower_can if follower else self.config.leader_can
        yield doctor_can.check_interface(
            robot, can.bus, run_probe(partial(doctor_probes.can_link, can.bus.channel), _PROBE_S)
        )
        because = self._bus_is_taken("follower-can-bridge" if follower else "leader", can.bus)
        if because:
            yield skipped(f"CAN nodes {robot}", because)
            yield skipped(f"watchdogs {robot}", because)
            return
        make = doctor_can.follower_nodes if follower else doctor_can.leader_nodes

        def ask() -> list[doctor_can.NodeReport] | None:
            nodes = make(self.config, self.examination.path)
            return doctor_can.ask_nodes(can.bus, can.master_node_id, nodes)

        probed = run_probe(ask, _BUS_S)
        yield doctor_can.check_nodes(robot, probed)
        yield doctor_can.check_watchdogs(robot, probed)

    def _bus_is_taken(self, master: str, bus: BusConfig) -> str:
        """Why its nodes are not asked; "" if they can be."""
        if master in self.report.alive:
            return f"{master} works on the bus; it read all of it back when it opened the bus"
        if not self.examination.devices:
            return "--no-devices"
        why = "" if bus.interface == "socketcan" else run_probe(partial(doctor_can.is_there, bus), _BUS_S).why
        if why and (bus.interface == "stepped" or "no socketcand server" in why):
            return "the bus is simulated and no simulation runs"
        return ""

    def _network(self, robot: Robot) -> Iterator[Finding]:
        network, folder = self.config.network, credentials_folder(self.config.network.credentials)
        name = network.of(robot).certificate
        running = self.report.of(FOLLOWER_GATEWAY if robot == "follower" else LEADER_GATEWAY)
        if running is not None:
            yield doctor_network.check_certificate(name, ProbeResult(running.certificate_left_s))
        elif not folder.exists() and not self.examination.hardware:
            yield skipped(f"certificate {name}", f"there is no {folder}", "for two computers: deploy/pki.sh")
        elif folder.exists() and not os.access(folder, os.R_OK | os.X_OK):
            yield skipped(f"certificate {name}", f"{folder} is root's", "sudo davpc doctor")
        else:
            yield doctor_network.check_certificate(
                name, run_probe(partial(check_credentials, folder, name), _PROBE_S)
            )
        yield doctor_network.check_access(robot, robot_access(network, robot), network.namespace, running)
        yield doctor_network.check_link(robot, running)


def default_robots(role: tuple[str, str] | None) -> tuple[Robot, ...]:
    """Whose parts to look at by default: those of the installed robot, else both."""
    known: tuple[Robot, ...] = ("follower", "leader")
    if role is None or role[1] != "hardware":
        return known
    return tuple(robot for robot in known if robot == role[0]) or known
