"""The estimator's state message: what it says of frames that are late, bad, or of a mission it does not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.channels import DRIVES, FRAME, MISSION
from common.config import Config
from common.frames.ring import FrameRing, Image
from common.geometry import Pose2, features_at
from common.messages import DockingState, Frame, Header, Message, Mission, encode
from common.node import Inbox, NodeContext
from common.timing import NS_PER_MS, NS_PER_S, SteppedClock
from follower.estimator.node import EstimatorNode
from follower.estimator.state import StateEstimator
from sim.optics.image import Optics, View
from tests.rigs.supervisor_rig import DRIVES as DRIVES_AT_REST

PERIOD_NS = 16_666_667
START_NS = 100 * NS_PER_S
HERE = Pose2(4.0, 0.0, 0.0)
MISSION_1 = Mission("acquire", "", 1, 1, False, "hold", 0.0, 0.0, 0.0, 0.0, (), "open", False, 0)
STANDING = replace(DRIVES_AT_REST, state="armed", epoch=1, measured_ns=START_NS)


class Rig:
    """The estimator's process beside a camera."""

    def __init__(self, config: Config, runtime: Path) -> None:
        self.camera = config.camera
        self.clock = SteppedClock(START_NS)
        self.node = EstimatorNode(NodeContext(config, Path("robots.toml"), runtime, 1, self.clock))
        self.inbox = Inbox(self.clock.boot_id)
        self.optics = Optics(config.camera, config.leds, 1)
        self.ring = FrameRing(runtime, config.camera.width_px, config.camera.height_px)
        self.sequence = 0
        self.pose = HERE
        self.blind_ns = 0
        self.angle_rad = 0.0

    def put(self, channel: object, message: Message, source: str, now_ns: int) -> None:
        header = Header(source, 1, self.sequence, now_ns, self.clock.boot_id)
        self.inbox.put_state(channel, encode(message, header), now_ns)  # type: ignore[arg-type]

    def look(self, age_ns: int = 5 * NS_PER_MS) -> DockingState:
        self.sequence += 1
        now_ns = START_NS + self.sequence * PERIOD_NS + self.blind_ns
        self.optics.render(self.ring.slot(self.sequence), View(self.sequence, self.pose, (1.0,) * 4))
        slot = self.ring.commit(self.sequence)
        camera = self.camera
        note = Frame(self.sequence, slot, now_ns - age_ns, "x", camera.width_px, camera.height_px, 600.0, 1.0)
        self.put(FRAME, note, "follower-camera", now_ns)
        self.inbox.begin_step()
        ((_, state),) = self.node.step(now_ns, self.inbox)
        assert isinstance(state, DockingState)
        return state

    def drive_blindly(self, speed_m_s: float, seconds: float, radius_m: float) -> None:
        """Without frames, stepped at 20 Hz."""
        for _ in range(round(20 * seconds)):
            self.blind_ns += NS_PER_S // 20
            now_ns = START_NS + self.sequence * PERIOD_NS + self.blind_ns
            self.angle_rad += speed_m_s / radius_m / 20
            rolling = replace(STANDING, wheel_angle_rad=(self.angle_rad,) * 2, measured_ns=now_ns)
            self.put(DRIVES, rolling, "follower-can-bridge", now_ns)
            self.put(MISSION, replace(MISSION_1, phase="approach"), "follower-supervisor", now_ns)
            self.inbox.begin_step()
            self.node.step(now_ns, self.inbox)
        self.pose = Pose2(self.pose.x_m - speed_m_s * seconds, self.pose.y_m, self.pose.theta_rad)


@pytest.fixture
def rig(config: Config, tmp_path: Path) -> Rig:
    return Rig(config, tmp_path)


@pytest.mark.parametrize("age_ms", [101, 5_000, -1, -60_000])
def test_a_late_frame_or_one_of_a_time_to_come_is_stale_and_leaves_no_trace(rig: Rig, age_ms: int) -> None:
    assert [rig.look().valid for _ in range(6)][-1]
    stale = rig.look(age_ms * NS_PER_MS)
    assert (stale.valid, stale.cause) == (False, "stale_frame")
    assert [rig.look().cause for _ in range(3)][-1] == "ok"


def by_papers_controller(config: Config) -> Config:
    controller = config.controller.model_copy(update={"method": "paper_fatrop"})
    return config.model_copy(update={"controller": controller})


def test_the_homography_is_left_to_the_papers_methods(rig: Rig, config: Config) -> None:
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    features = tuple((float(a), float(b)) for a, b in desired)
    rig.put(MISSION, replace(MISSION_1, desired_features=features), "follower-supervisor", START_NS)
    last = [rig.look() for _ in range(6)][-1]
    assert (last.valid, last.theta_homography_rad) == (True, None)


def test_a_mission_for_other_leds_gives_no_homography(config: Config, tmp_path: Path) -> None:
    rig = Rig(by_papers_controller(config), tmp_path)
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    for points, solved in ((desired[:3], False), (desired[:0], False), (desired, True)):
        now_ns = START_NS + (rig.sequence + 1) * PERIOD_NS
        features = tuple((float(a), float(b)) for a, b in points)
        rig.put(MISSION, replace(MISSION_1, desired_features=features), "follower-supervisor", now_ns)
        last = [rig.look() for _ in range(6)][-1]
        assert last.valid
        assert (last.theta_homography_rad is not None) == solved


def test_a_camera_that_comes_back_finds_the_array_where_the_robot_has_driven_meanwhile(
    rig: Rig, config: Config
) -> None:
    assert [rig.look().valid for _ in range(6)][-1]
    rig.drive_blindly(0.4, 2.0, config.base.wheel_radius_m)
    now_ns = START_NS + (rig.sequence + 1) * PERIOD_NS + rig.blind_ns
    rig.put(DRIVES, replace(STANDING, measured_ns=now_ns), "follower-can-bridge", now_ns)
    last = [rig.look() for _ in range(12)][-1]
    assert (last.valid, last.cause) == (True, "ok")
    assert last.x_m == pytest.approx(rig.pose.x_m, abs=0.05)


def test_speeds_that_no_wheel_can_have_are_not_driven(rig: Rig) -> None:
    for _ in range(10):
        now_ns = START_NS + (rig.sequence + 1) * PERIOD_NS
        fast = replace(STANDING, wheel_speed_rad_s=(1e9, 1e9))
        rig.put(DRIVES, fast, "follower-can-bridge", now_ns)
        state = rig.look()
    assert state.valid
    assert state.x_m == pytest.approx(HERE.x_m, abs=0.1)


def frame(config: Config, sequence: int) -> Frame:
    camera = config.camera
    return Frame(sequence, 0, sequence * PERIOD_NS, "x", camera.width_px, camera.height_px, 600.0, 1.0)


@pytest.mark.parametrize(
    ("cause", "spoil"),
    [
        ("no_frame", lambda _: None),
        ("bad_frame", lambda image: image[:10]),
        ("overexposed", lambda image: np.full_like(image, 255)),
        ("underexposed", lambda image: np.zeros_like(image)),
    ],
)
def test_the_pose_is_carried_on_briefly_and_the_frames_own_cause_is_reported(
    config: Config, cause: str, spoil: object
) -> None:
    estimator, optics = StateEstimator(config), Optics(config.camera, config.leds, 1)
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    for sequence in range(1, 11):
        optics.render(image, View(sequence, HERE, (1.0,) * 4))
        state = estimator.step(frame(config, sequence), image, (0.0, 0.0), None)
    assert (state.valid, state.cause) == (True, "ok")
    bad = [estimator.step(frame(config, n), spoil(image), (0.0, 0.0), None) for n in range(11, 19)]  # type: ignore[operator]
    assert {state.cause for state in bad} == {cause}
    assert [state.valid for state in bad] == [True] * 5 + [False] * 3


@pytest.mark.parametrize("method", ["paper", "davpc"])
def test_the_paper_takes_the_heading_from_the_homography(config: Config, method: str) -> None:
    papers = by_papers_controller(config)
    tuned = papers.model_copy(update={"estimator": config.estimator.model_copy(update={"method": method})})
    estimator, optics = StateEstimator(tuned), Optics(config.camera, config.leds, 1)
    desired = features_at(config.leds.points, config.docking.goal(1), config.camera.mount)
    image: Image = np.zeros((config.camera.height_px, config.camera.width_px), np.uint8)
    for sequence in range(1, 20):
        optics.render(image, View(sequence, HERE, (1.0,) * 4, pitch_rad=0.01))
        seen = estimator.step(frame(config, sequence), image, (0.0, 0.0), desired)
        if seen.valid:
            break
    assert seen.theta_homography_rad is not None
    assert seen.fit is not None
    route, other = seen.theta_homography_rad, seen.fit[2]
    assert abs(route - other) > 1e-4
    assert seen.theta_rad == pytest.approx(route if method == "paper" else other, abs=1e-9)
