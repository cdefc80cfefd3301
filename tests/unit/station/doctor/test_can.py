"""``davpc doctor`` at a CAN bus: the kernel's interface, node identities and watchdogs read back, nothing written."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from common.canopen.bus import CanBus
from common.canopen.frames import SDO_REQUEST
from common.config import BusConfig
from common.errors import DeviceError
from station.doctor.can import (
    NodeReport,
    ask_nodes,
    check_interface,
    check_nodes,
    check_watchdogs,
    follower_nodes,
    has_master,
    leader_nodes,
)
from station.doctor.findings import ProbeResult, run_probe
from tests.rigs.canbus_rig import CONFIG_PATH, Rig, Tap, follower_rig, leader_rig
from tests.rigs.station_rig import found

REAL = BusConfig(interface="socketcan", channel="can0")
UPLOAD = 0x40


def ask(rig: Rig) -> list[NodeReport] | None:
    can = rig.config.follower_can
    return ask_nodes(can.bus, can.master_node_id, follower_nodes(rig.config, CONFIG_PATH))


def test_nodes_just_switched_on_answer_and_have_no_watchdog_yet() -> None:
    with follower_rig() as rig:
        tap = Tap(rig)
        seen = ProbeResult(ask(rig))
        found(check_nodes("follower", seen), "ok", "12 answer")
        found(check_watchdogs("follower", seen), "warning", "12 of 12 not set")
        sent = [frame for _, frame in tap.read() if frame.can_id & 0x780 != 0x580]
        assert sent
        assert {frame.can_id & 0x780 for frame in sent} == {SDO_REQUEST}, "nothing but SDO requests"
        assert all(frame.data[0] == UPLOAD for frame in sent), "nothing but uploads"
        tap.close()


def test_watchdogs_that_a_bridge_has_set_are_read_back() -> None:
    with follower_rig() as rig:
        rig.drives.open()
        rig.drives.close()
        seen = ProbeResult(ask(rig))
        found(check_nodes("follower", seen), "ok")
        found(check_watchdogs("follower", seen), "ok", "12 set as configured")


def test_a_speed_limit_of_another_geometry_is_noticed() -> None:
    with follower_rig() as rig:
        rig.drives.open()
        rig.drives.close()
        base = rig.config.base.model_copy(update={"wheel_radius_m": 0.5 * rig.config.base.wheel_radius_m})
        changed = rig.config.model_copy(update={"base": base})
        can = rig.config.follower_can
        reports = ask_nodes(can.bus, can.master_node_id, follower_nodes(changed, CONFIG_PATH))
        found(
            check_watchdogs("follower", ProbeResult(reports)), "warning", "2 of 12 not set; left wheel: speed limit"
        )


def test_a_silent_node_and_a_stranger_are_named() -> None:
    with follower_rig() as rig:
        rig.robot.bus.faults.silent.add(13)
        nodes = follower_nodes(rig.config, CONFIG_PATH)
        nodes[0] = dataclasses.replace(nodes[0], serial=7)
        can = rig.config.follower_can
        seen = ProbeResult(ask_nodes(can.bus, can.master_node_id, nodes))
        found(check_nodes("follower", seen), "failed", "left wheel")
        assert seen.value is not None
        strangers = [answer.misfit for answer in seen.value if answer.misfit]
        assert "serial number" in strangers[0]
        assert "node 13 (left joint 3)" in strangers[1]
        found(check_nodes("follower", seen), "failed", "(and 1 more)")


def test_a_master_at_work_is_noticed() -> None:
    with follower_rig() as rig:
        master_id = rig.config.follower_can.master_node_id
        rig.enable()
        bus = CanBus(rig.config.follower_can.bus)
        try:
            assert not has_master(bus, master_id)
            rig.cycle()
            assert has_master(bus, master_id)
        finally:
            bus.close()


def test_a_bus_with_a_master_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.doctor.can.has_master", lambda *_: True)
    with follower_rig() as rig:
        tap = Tap(rig)
        seen = ProbeResult(ask(rig))
        assert tap.read() == []
        tap.close()
    found(check_nodes("follower", seen), "skipped", "another master")
    found(check_watchdogs("follower", seen), "skipped", "another master")


def test_the_leaders_module() -> None:
    with leader_rig() as (config, _, _, _):
        can = config.leader_can
        seen = ProbeResult(ask_nodes(can.bus, can.master_node_id, leader_nodes(config, CONFIG_PATH)))
        found(check_nodes("leader", seen), "ok", "1 answer")
        found(check_watchdogs("leader", seen), "warning", "watchdog 200 ms")


def test_a_drive_without_the_object_fails() -> None:
    answers = [NodeReport("left wheel", refused=("node 1 (left wheel): object 6007h:00: …",))]
    found(check_watchdogs("follower", ProbeResult(answers)), "failed", "6007h")
    found(check_watchdogs("follower", ProbeResult(why="CAN bus can0: cannot be opened")), "failed", "can0")
    strangers = [NodeReport("left wheel", misfit="node 1: silent")]
    found(check_watchdogs("follower", ProbeResult(strangers)), "skipped", "no node answers")


def link(**data: Any) -> ProbeResult[Any]:
    known: dict[str, Any] = {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 1_000_000}, "restart_ms": 100}
    flags = data.pop("flags", ["NOARP", "UP"])
    length = data.pop("txqlen", 128)
    return ProbeResult({"flags": flags, "txqlen": length, "linkinfo": {"info_data": {**known, **data}}})


def test_interface() -> None:
    found(check_interface("follower", REAL, link()), "ok", "ERROR-ACTIVE")
    found(check_interface("follower", REAL, link(flags=[])), "failed", "can0 is down")
    found(check_interface("follower", REAL, link(bittiming={"bitrate": 500_000})), "failed", "configured are 1000000")
    found(check_interface("follower", REAL, link(state="BUS-OFF")), "failed", "termination")
    found(check_interface("follower", REAL, link(state="ERROR-PASSIVE")), "warning", "errors on the wire")
    found(check_interface("follower", REAL, link(restart_ms=0)), "warning", "bus-off")
    found(check_interface("follower", REAL, link(txqlen=10)), "warning", "transmit queue 10")
    missing: ProbeResult[Any] = run_probe(_absent, 10.0)
    found(check_interface("follower", REAL, missing), "failed", "there is no interface can0")
    with follower_rig() as rig:
        found(check_interface("follower", rig.config.follower_can.bus, missing), "skipped", "simulated")


def _absent() -> Any:
    raise DeviceError("there is no interface can0")
