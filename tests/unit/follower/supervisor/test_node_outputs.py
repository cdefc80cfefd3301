"""What the supervisor's process publishes: mission, summary, requests to the Leader, and the end of manual mode."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.channels import (
    ARM_STATE,
    COMMAND,
    DOCK_REQUEST,
    DOCKING_STATE,
    DRIVES,
    FOLLOWER_SUMMARY,
    FRAME,
    LEADER_STATE,
    LOCK_REQUEST,
    MANUAL_REQUEST,
    MISSION,
    Channel,
)
from common.geometry import Pose2
from common.messages import Answer, Command, DockRequest, Drives, Frame, Header, ManualRequest, Mission, seal_command
from common.node import Inbox, NodeContext, Outbox, Received
from common.timing import NS_PER_S, SteppedClock
from follower.supervisor.journal import Journal
from follower.supervisor.node import SupervisorNode
from tests.rigs.canbus_rig import CONFIG_PATH, stepped_config
from tests.rigs.supervisor_rig import ARMS, LEADER, STEP_NS, docking_state  # fmt: skip
from tests.rigs.supervisor_rig import DRIVES as MEASURED

BOOT = "stepped"


class Process:
    """The node with an inbox of fresh messages around it."""

    def __init__(self, folder: Path) -> None:
        self.config = stepped_config()
        self.node = SupervisorNode(NodeContext(self.config, CONFIG_PATH, folder, 1, SteppedClock(NS_PER_S)))
        self.inbox, self.now_ns = Inbox(BOOT), NS_PER_S
        self.runs: dict[str, int] = {}
        self.drives: Drives = MEASURED
        self.says: dict[Channel[Any], Any] = {
            DOCKING_STATE: docking_state(self.config, Pose2(5.0, 0.1, 0.0)),
            ARM_STATE: ARMS,
            LEADER_STATE: LEADER,
        }
        self.commanded = True

    def ask(self, channel: Channel[Any], request: Any) -> None:
        header = Header("test", 1, 1, self.now_ns, BOOT)
        self.inbox.put_request(channel, Received(request, header, self.now_ns))

    def step(self) -> list[tuple[Channel[Any], Any]]:
        for _ in range(5):
            self.now_ns += STEP_NS // 5
            self._publish()
        self.inbox.begin_step()
        outputs = list(self.node.step(self.now_ns, self.inbox))
        (mission,) = [message for _, message in outputs if isinstance(message, Mission)]
        armed = "armed" if mission.armed else "disarmed"
        self.drives = replace(self.drives, state=armed, epoch=mission.epoch)  # type: ignore[arg-type] # one of them
        return outputs

    def _publish(self) -> None:
        """As often as the processes do: their loops come in time."""
        messages = {**self.says, DRIVES: replace(self.drives, measured_ns=self.now_ns)}
        if self.commanded:
            messages[COMMAND] = seal_command(Command(0.0, 0.0, self.drives.epoch, 1, 1, 1, 1, 1))
        for channel, message in messages.items():
            sender = Outbox(channel.publisher, self.runs.get(channel.publisher, 1), BOOT)
            self.inbox.put_state(channel, sender.pack(channel, message, self.now_ns), self.now_ns)

    def missions(self, count: int) -> list[Mission]:
        return [dict(self.step())[MISSION] for _ in range(count)]

    def start(self) -> None:
        self.missions(10)
        self.ask(DOCK_REQUEST, DockRequest("start-1", self.now_ns + NS_PER_S, "start"))


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Process]:
    made = Process(tmp_path)
    yield made
    made.node.stop(made.now_ns)


def test_it_steps_twenty_times_a_second_under_its_own_name(process: Process) -> None:
    assert (process.node.name, process.node.trigger.period_ns) == ("follower-supervisor", NS_PER_S // 20)


def test_a_mission_each_step_and_a_summary_every_other(process: Process) -> None:
    published = [[channel for channel, _ in process.step()] for _ in range(4)]
    assert published == [[MISSION], [MISSION, FOLLOWER_SUMMARY]] * 2


def test_a_command_in_time_lets_it_arm(process: Process) -> None:
    process.start()
    process.commanded = False
    assert process.missions(12)[-1].waiting == "controller silent"
    process.commanded = True
    assert process.missions(14)[-1].phase == "approach"


def test_a_restart_ends_the_docking_by_name(process: Process) -> None:
    process.start()
    assert process.missions(14)[-1].phase == "approach"
    process.runs["follower-estimator"] = 2
    mission = process.missions(1)[0]
    assert (mission.phase, mission.cause) == ("aborted", "restarted: follower-estimator")


def test_each_phase_is_logged_once_and_each_attempt_is_kept(
    process: Process, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, logger="follower-supervisor"):
        process.start()
        process.missions(20)
        process.ask(DOCK_REQUEST, DockRequest("abort-1", process.now_ns + NS_PER_S, "abort"))
        process.step()
        process.node.stop(process.now_ns)
    (line,) = next(tmp_path.rglob("attempts.jsonl")).read_text().splitlines()
    assert json.loads(line)["cause"] == "operator_abort", "nothing that was queued is lost"
    said = [record.getMessage().strip() for record in caplog.records if record.name == "follower-supervisor"]
    assert [text for text in said if text.startswith("phase")] == [
        "phase acquire",
        "phase approach",
        "phase aborted operator_abort",
    ]


def test_the_request_to_lock_goes_out(process: Process) -> None:
    process.start()
    process.missions(14)
    sequence = process.node._sequence
    goal = process.config.docking.goal(1)
    process.drives = replace(process.drives, wheel_angle_rad=(100.0, 100.0))
    process.says[DOCKING_STATE] = docking_state(process.config, goal)
    process.missions(36)
    radius = process.config.base.wheel_radius_m
    for pushed_m, arms in ((0.06, replace(ARMS, contact=True)), (0.14, replace(ARMS, contact=True, connected=True))):
        turned = 100.0 + pushed_m / radius
        process.drives = replace(process.drives, wheel_angle_rad=(turned, turned))
        process.says[DOCKING_STATE] = docking_state(process.config, Pose2(goal.x_m - 0.14, 0.0, 0.0))
        process.says[ARM_STATE] = arms
        outputs = process.step()
    assert sequence.phase == "lock"
    (request,) = [message for channel, message in outputs if channel is LOCK_REQUEST]
    assert (request.action, request.trolley) == ("lock", 1)
    assert not [message for channel, message in process.step() if channel is LOCK_REQUEST]


def test_in_manual_mode_the_summary_says_armed_and_moving_until_its_station_is_silent(process: Process) -> None:
    process.commanded = False
    process.missions(2)
    process.ask(MANUAL_REQUEST, ManualRequest("hand", process.now_ns + NS_PER_S, "start"))
    summaries = [message for _ in range(2) for channel, message in process.step() if channel is FOLLOWER_SUMMARY]
    assert [(each.phase, each.armed, each.moving) for each in summaries] == [("manual", True, True)]
    phases = [mission.phase for mission in process.missions(60)]
    assert phases[30] == "manual"
    assert phases[-1] == "idle", "no command of that epoch has arrived"
    assert process.missions(1)[0].cause == "manual: station_silent"


def test_an_idle_summary_is_that_of_the_docking(process: Process) -> None:
    process.missions(9)
    summary = dict(process.step())[FOLLOWER_SUMMARY]
    assert (summary.phase, summary.armed, summary.moving) == ("idle", False, False)


def test_frames_of_another_camera_keep_it_from_beginning(process: Process) -> None:
    process.node._calibration._camera = "A1"
    frame = Frame(1, 0, process.now_ns, "B2", 1280, 1024, 5000.0, 1.0)
    process.says[FRAME] = frame
    process.start()
    answers = [message for _, message in process.step() if isinstance(message, Answer)]
    assert [answer.outcome for answer in answers] == ["refused"]
    assert "is of camera A1, frames come from B2" in answers[0].reason


def test_a_stop_waits_for_what_is_still_to_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[Journal] = []
    monkeypatch.setattr(Journal, "close", lambda journal: closed.append(journal))
    process = Process(tmp_path)
    process.node.stop(process.now_ns)
    assert closed == [process.node._journal]
    monkeypatch.undo()
    process.node.stop(process.now_ns)
