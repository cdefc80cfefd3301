"""``davpc doctor`` beside running gateways: are the rules that they work by those of the configuration?"""

from __future__ import annotations

import pytest

from common.channels import FOLLOWER_GATEWAY
from common.config import load_config
from common.messages import GatewayState
from gateway.access import robot_access
from station.doctor.bus import RobotReport, listen
from station.doctor.findings import ProbeResult
from station.doctor.network import check_access, check_certificate, check_link
from tests.net.gateways import READY_S, Gateways, needs_openssl
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.waiting import until

pytestmark = [pytest.mark.alone, needs_openssl]


def heard_gateway(gateways: Gateways) -> GatewayState:
    """What the Follower's gateway says of itself, as the doctor hears it."""
    found: list[RobotReport] = []

    def is_heard() -> bool:
        found[:] = [listen(gateways.runtime("follower"), gateways.namespace, 1.0)]
        return found[0].of(FOLLOWER_GATEWAY) is not None

    until(is_heard, READY_S)
    state = found[0].of(FOLLOWER_GATEWAY)
    assert state is not None
    assert "follower-gateway" in found[0].alive
    return state


def test_rules_link_and_certificate_of_a_running_gateway(gateways: Gateways) -> None:
    state = heard_gateway(gateways)
    network = load_config(CONFIG_PATH, gateways.settings).network
    same = check_access("follower", robot_access(network, "follower"), network.namespace, state)
    assert same.status == "ok", same
    assert "as the gateway applies them" in same.seen
    edited = load_config(CONFIG_PATH, [*gateways.settings, "network.operators=[]"]).network
    other = check_access("follower", robot_access(edited, "follower"), edited.namespace, state)
    assert other.status == "failed", other
    assert check_link("follower", state).status == "ok"
    assert check_certificate("follower", ProbeResult(state.certificate_left_s)).status == "ok"
