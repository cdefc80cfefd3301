"""The supervisor's process: what it refuses to begin."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from common.channels import DOCK_REQUEST
from common.channels import DRIVES as DRIVES_CHANNEL
from common.messages import Answer, DockRequest
from common.node import Inbox, NodeContext, Outbox
from common.timing import NS_PER_S, SteppedClock
from follower.supervisor.node import SupervisorNode
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config
from tests.rigs.supervisor_rig import DRIVES


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
