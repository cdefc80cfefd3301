"""Hypotheses about the disturbance: their weights, their branches, and that the right one takes over in time."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from common.config import default_config_path, load_config
from common.geometry import Pose2, features_at
from follower.estimator.hypotheses import ALL, QUIET, SIDEWAYS, YAW, Branching
from follower.estimator.observer import RelativeObserver
from follower.model.motion import DISTURBANCE, NO_DISTURBANCE, POSE, MotionDisturbance, advance

CONFIG = load_config(default_config_path())
POINTS, CAMERA = CONFIG.leds.points, CONFIG.camera.mount
FRAME_NS = 16_666_667
HERE = np.array([4.0, 0.1, 0.05])
BY_DISTURBANCE = np.array([[-0.3, 0.0, 0.1, 0.0], [0.0, 0.0, -4.0, -1.0], [0.0, 0.0, -1.0, 0.0]])


def branching() -> Branching:
    return Branching(CONFIG.estimator.disturbance)


def test_at_first_it_is_likely_quiet_and_all_kinds_are_thought_of() -> None:
    first = branching().begin(HERE, 0.01 * np.eye(3))
    assert first.weights.sum() == pytest.approx(1.0)
    assert tuple(first.kinds[first.likeliest]) == QUIET
    assert {tuple(kind) for kind in first.kinds.tolist()} >= {QUIET, YAW, SIDEWAYS, ALL}
    np.testing.assert_allclose(first.mean()[POSE], HERE)
    np.testing.assert_allclose(first.pose_covariance(), 0.01 * np.eye(3), atol=1e-12)


def test_mean_and_covariance_are_those_of_the_mixture_also_across_the_turn_of_the_angle() -> None:
    two = branching().begin(np.array([4.0, 0.0, np.pi - 0.01]), 1e-4 * np.eye(3)).take(np.array([0, 1]))
    two.states[1, 2], two.states[1, 0] = -np.pi + 0.03, 4.2
    two.log_weights = np.log([0.5, 0.5])
    mean = two.mean()
    assert abs(mean[2]) == pytest.approx(np.pi - 0.01)
    assert mean[0] == pytest.approx(4.1)
    assert two.pose_covariance()[0, 0] == pytest.approx(1e-4 + 0.1**2)


def test_a_branch_leaves_its_parent_and_costs_its_probability() -> None:
    tree = branching()
    first = tree.begin(HERE, 1e-4 * np.eye(3))
    grown = tree.branch(first, BY_DISTURBANCE, 0.12)
    assert len(grown.states) > len(first.states)
    np.testing.assert_array_equal(grown.states[: len(first.states)], first.states)
    children = grown.generations == 1
    assert grown.log_weights[children].max() < first.log_weights.max() - 3.0
    yaw = children & (grown.kinds == YAW).all(axis=1)
    assert grown.covariances[yaw][0, 5, 5] > CONFIG.estimator.disturbance.onset_sigma[2] ** 2
    assert grown.covariances[yaw][0, 1, 5] < 0.0, "a yaw that began has moved the pose already"


def test_the_end_of_a_disturbance_takes_back_what_it_moved_too_far() -> None:
    tree = branching()
    known = tree.begin(HERE, 1e-4 * np.eye(3))
    known.log_weights[:] = -20.0
    known.log_weights[known.kinds.all(axis=1)] = 0.0
    known.states[:, DISTURBANCE] = [0.0, 0.0, 0.1, 0.0]
    grown = tree.branch(known, BY_DISTURBANCE, 0.1)
    ended = grown.take(np.flatnonzero((grown.generations == 1) & ~grown.kinds.any(axis=1)))
    assert len(ended.states) == 1
    np.testing.assert_array_equal(ended.states[0, DISTURBANCE], 0.0)
    np.testing.assert_allclose(ended.states[0, POSE], HERE - BY_DISTURBANCE[:, 2] * 0.1 * 0.05)


def test_unlikely_ones_are_dropped_but_the_newest_are_given_time() -> None:
    tree = branching()
    grown = tree.branch(tree.begin(HERE, 1e-4 * np.eye(3)), BY_DISTURBANCE, 0.12)
    grown.log_weights[1:] -= 15.0
    kept = tree.prune(grown)
    assert set(kept.generations.tolist()) == {0, 1}
    grown = kept
    for _ in range(6):
        grown.log_weights[1:] -= 15.0
        grown = tree.branch(grown, BY_DISTURBANCE, 0.12)
    assert grown.generations.min() == 0, "the likeliest stays"
    assert np.sum(grown.generations < 4) == 1


def test_a_history_that_drove_past_the_array_does_not_blind_the_others() -> None:
    observer, here, sigma = RelativeObserver(POINTS, CAMERA, CONFIG.estimator), Pose2(2.0, 0.0, 0.0), 0.01
    observer.reset(here, 1e-4 * np.eye(3), 0)
    observer._known.states[2, 0] = -1.0
    assert observer.update(features_at(POINTS, here, CAMERA), sigma).all()
    assert observer.pose.x_m == pytest.approx(2.0, abs=1e-6)
    observer.reset(Pose2(-1.0, 0.0, 0.0), 1e-4 * np.eye(3), 0)
    assert not observer.update(features_at(POINTS, here, CAMERA), sigma).any()


@pytest.mark.parametrize("sigma_px", [0.3, 3.0])
def test_no_change_of_the_disturbance_locks_the_measurement_out(sigma_px: float) -> None:
    """A pad on top of a constant bias, its end, and the bias's end: the images never contradict every hypothesis."""
    random, sigma = np.random.default_rng(8), sigma_px / CONFIG.camera.lens.fx_px
    observer, truth = RelativeObserver(POINTS, CAMERA, CONFIG.estimator), Pose2(5.0, 0.2, 0.1)
    observer.reset(truth, np.diag([1e-3, 1e-3, 1e-4]), 0)
    parts = (
        (NO_DISTURBANCE, 60),
        (MotionDisturbance(yaw_rad_s=0.05), 180),
        (MotionDisturbance(-0.25, -0.4, 0.13, 0.03), 180),
        (MotionDisturbance(yaw_rad_s=0.05), 180),
        (NO_DISTURBANCE, 180),
    )
    frame = refused = most_refused = 0
    for disturbance, frames in parts:
        for _ in range(frames):
            frame += 1
            v, w = 0.25, 0.05 * np.sin(frame / 40)
            moved = advance(np.array([*truth.as_array(), *astuple(disturbance)]), v, w, FRAME_NS * 1e-9)[0]
            truth = Pose2(*moved[:3])
            observer.predict(frame * FRAME_NS, v, w)
            seen = features_at(POINTS, truth, CAMERA) + sigma * random.standard_normal((len(POINTS), 2))
            refused = refused + 1 if observer.update(seen, sigma).sum() < 2 else 0
            most_refused = max(refused, most_refused)
        assert observer.disturbance.yaw_rad_s == pytest.approx(disturbance.yaw_rad_s, abs=0.03)
        assert np.linalg.eigvalsh(observer.covariance).min() > 0.0
    assert most_refused < 3
    assert np.abs(observer.pose.as_array() - truth.as_array()).max() < (0.01 if sigma_px < 1 else 0.05)
