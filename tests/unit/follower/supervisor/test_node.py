"""The supervisor's process: what it refuses to begin, and who answers a request."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from common.channels import ARM_STATE, COMMAND, DOCK_REQUEST, FOLLOWER_GATEWAY, MANUAL_REQUEST
from common.channels import DRIVES as DRIVES_CHANNEL
from common.messages import (
    Answer,
    Command,
    DockRequest,
    Drives,
    GatewayState,
    Header,
    ManualRequest,
    Mission,
    seal_command,
)
from common.node import Inbox, NodeContext, Outbox, Received
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock
from follower.supervisor.node import SupervisorNode
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config
from tests.rigs.supervisor_rig import ARMS, DRIVES

COMMANDED = seal_command(Command(0.0, 0.0, 0, 1, 1, 1, 1, 1))


def refusal(folder: Path, drives: Drives = DRIVES, overrides: tuple[str, ...] = (), gateway_s: float = 1e7) -> str:
    """Why a docking that is asked for is refused, without what is done about it; empty if it is not."""
    config = stepped_config(*overrides)
    node = SupervisorNode(NodeContext(config, CONFIG_PATH, folder, 1, SteppedClock(NS_PER_S)))
    inbox, sender = Inbox("stepped"), Outbox("test", 1, "stepped")
    request = DockRequest("start-1", 2 * NS_PER_S, "start")
    for channel, message in (
        (DRIVES_CHANNEL, replace(drives, measured_ns=NS_PER_S)),
        (FOLLOWER_GATEWAY, GatewayState(True, gateway_s, "")),
    ):
        inbox.put_state(channel, sender.pack(channel, message, NS_PER_S), NS_PER_S)
    inbox.put_request(DOCK_REQUEST, Received(request, Header("test", 1, 1, NS_PER_S, "stepped"), NS_PER_S))
    inbox.begin_step()
    outputs = node.step(NS_PER_S, inbox)
    node.stop(NS_PER_S)
    (answer,) = [message for _, message in outputs if isinstance(message, Answer)]
    assert answer.outcome in ("accepted", "refused")
    return "" if answer.outcome == "accepted" else answer.reason


def test_what_is_not_fit_to_dock_is_refused_by_name(tmp_path: Path) -> None:
    """docs/safety.md S32, S45, S46."""
    assert refusal(tmp_path) == ""
    assert refusal(tmp_path, replace(DRIVES, battery_v=21.9)).startswith("battery at 21.9 V")
    assert refusal(tmp_path, replace(DRIVES, battery_v=None)).startswith("battery voltage not readable")
    assert refusal(tmp_path, gateway_s=3600.0).startswith("the certificate expires in 1.0 h")
    missing = refusal(tmp_path, overrides=("camera.calibration='none.toml'",))
    assert missing.startswith("camera.calibration: ")
    assert "none.toml" in missing


def test_a_process_whose_loops_are_late_is_named_while_it_is_so(tmp_path: Path) -> None:
    """docs/safety.md S29: with three late loops within a second the robot is unwell."""
    node = SupervisorNode(NodeContext(stepped_config(), CONFIG_PATH, tmp_path, 1, SteppedClock(NS_PER_S)))
    inbox, sender = Inbox("stepped"), Outbox("test", 1, "stepped")
    waiting = []
    request = DockRequest("start-1", 20 * NS_PER_S, "start")
    inbox.put_request(DOCK_REQUEST, Received(request, Header("test", 1, 1, NS_PER_S, "stepped"), NS_PER_S))
    for now_ms in range(1000, 3200, 50):
        for sent_ms in range(now_ms - 50, now_ms, 50 if now_ms < 2000 else 10):
            for channel, message in ((DRIVES_CHANNEL, DRIVES), (COMMAND, COMMANDED)):
                inbox.put_state(channel, sender.pack(channel, message, sent_ms * NS_PER_MS), sent_ms * NS_PER_MS)
        inbox.begin_step()
        outputs = node.step(now_ms * NS_PER_MS, inbox)
        waiting += [message.waiting for _, message in outputs if isinstance(message, Mission)]
    node.stop(4 * NS_PER_S)
    late = ["runs late" in text for text in waiting]
    assert late[4:20] == [True] * 16
    assert late[-4:] == [False] * 4


def test_manual_mode_answers_docking_requests_only_while_it_is_on(tmp_path: Path) -> None:
    node = SupervisorNode(NodeContext(stepped_config(), CONFIG_PATH, tmp_path, 1, SteppedClock(NS_PER_S)))
    inbox, sender = Inbox("stepped"), Outbox("test", 1, "stepped")
    inbox.put_state(
        DRIVES_CHANNEL, sender.pack(DRIVES_CHANNEL, replace(DRIVES, measured_ns=NS_PER_S), NS_PER_S), NS_PER_S
    )
    inbox.put_state(ARM_STATE, sender.pack(ARM_STATE, ARMS, NS_PER_S), NS_PER_S)

    def ask(*requests: DockRequest | ManualRequest) -> dict[str, str]:
        for request in requests:
            channel = DOCK_REQUEST if isinstance(request, DockRequest) else MANUAL_REQUEST
            inbox.put_request(channel, Received(request, Header("test", 1, 1, NS_PER_S, "stepped"), NS_PER_S))
        inbox.begin_step()
        return {m.id: m.outcome for _, m in node.step(NS_PER_S, inbox) if isinstance(m, Answer)}

    later_ns = 2 * NS_PER_S
    start = DockRequest("dock", later_ns, "start")
    assert ask(ManualRequest("hand", later_ns, "start"), start) == {"hand": "accepted", "dock": "refused"}
    assert ask(DockRequest("abort", later_ns, "abort"), start) == {"abort": "done", "dock": "accepted"}
    node.stop(NS_PER_S)
