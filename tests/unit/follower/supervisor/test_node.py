"""The supervisor's process: what it refuses to begin, and who answers a request."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from common.channels import ARM_STATE, DOCK_REQUEST, MANUAL_REQUEST
from common.channels import DRIVES as DRIVES_CHANNEL
from common.messages import Answer, DockRequest, ManualRequest
from common.node import Inbox, NodeContext, Outbox
from common.timing import NS_PER_S, SteppedClock
from follower.supervisor.node import SupervisorNode
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config
from tests.rigs.supervisor_rig import ARMS, DRIVES


def test_with_an_undervoltage_the_process_refuses_to_begin(tmp_path: Path) -> None:
    config = stepped_config()
    node = SupervisorNode(NodeContext(config, CONFIG_PATH, tmp_path, 1, SteppedClock(NS_PER_S)))
    inbox, sender = Inbox("stepped"), Outbox("test", 1, "stepped")
    request = DockRequest("start-1", 2 * NS_PER_S, "start")
    empty = replace(DRIVES, battery_v=21.9, measured_ns=NS_PER_S)
    inbox.put_state(DRIVES_CHANNEL, sender.pack(DRIVES_CHANNEL, empty, NS_PER_S), NS_PER_S)
    inbox.put_queued(DOCK_REQUEST, inbox.decode(DOCK_REQUEST, sender.pack(DOCK_REQUEST, request, NS_PER_S), NS_PER_S))
    inbox.begin_step()
    outputs = node.step(NS_PER_S, inbox)
    node.stop(NS_PER_S)
    answers = [message for _, message in outputs if isinstance(message, Answer)]
    assert [(answer.outcome, answer.reason.partition(",")[0]) for answer in answers] == [
        ("refused", "battery at 21.9 V")
    ]


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
            payload = sender.pack(channel, request, NS_PER_S)
            inbox.put_queued(channel, inbox.decode(channel, payload, NS_PER_S))
        inbox.begin_step()
        return {m.id: m.outcome for _, m in node.step(NS_PER_S, inbox) if isinstance(m, Answer)}

    later_ns = 2 * NS_PER_S
    start = DockRequest("dock", later_ns, "start")
    assert ask(ManualRequest("hand", later_ns, "start"), start) == {"hand": "accepted", "dock": "refused"}
    assert ask(DockRequest("abort", later_ns, "abort"), start) == {"abort": "done", "dock": "accepted"}
    node.stop(NS_PER_S)
