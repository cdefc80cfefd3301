"""The array's projection: its derivatives, and that its three ways give the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import Config
from common.geometry import Array, Pose2, features_at
from follower.model.array import LedArray, feature_jacobian, led_by_led, project_led, tilt_of

STEP = 1e-6
states = st.tuples(
    st.floats(1.2, 10.0), st.floats(-1.0, 1.0), st.floats(-0.8, 0.8), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)
)


def differences(array: LedArray, state: Array) -> Array:
    """Central differences (2, n, m) of the features by one state (m,)."""
    moves = STEP * np.eye(len(state))
    ahead, behind = array.project(state + moves)[0], array.project(state - moves)[0]
    return np.moveaxis((ahead - behind) / (2 * STEP), 0, -1)


@settings(max_examples=60, deadline=None)
@given(states)
def test_every_way_gives_the_same_features_and_their_derivatives(config: Config, drawn: tuple[float, ...]) -> None:
    points, mount, state = config.leds.points, config.camera.mount, np.array(drawn)
    array = LedArray(points, mount)
    tilted, slopes, depth = (values[0] for values in array.project(state[None]))
    assert slopes == pytest.approx(differences(array, state), abs=1e-7)
    for led, point in enumerate(points.tolist()):
        by_alpha, by_beta, alpha, beta, ahead = project_led(point, drawn, tuple(mount.tolist()), tilt_of(drawn))
        assert (alpha, beta, ahead) == pytest.approx((*tilted[:, led], depth[led]), abs=1e-12)
        assert np.array([by_alpha, by_beta]) == pytest.approx(slopes[:, led], abs=1e-12)

    level, level_slopes, _ = (values[0] for values in array.project(state[None, :3]))
    assert level_slopes == pytest.approx(differences(array, state[:3]), abs=1e-7)
    untilted = np.array([*drawn[:3], 0.0, 0.0])[None]
    same, same_slopes, _ = (values[0] for values in array.project(untilted))
    assert same == pytest.approx(level, abs=1e-12)
    assert same_slopes[..., :3] == pytest.approx(level_slopes, abs=1e-12)

    pose = Pose2(*drawn[:3])
    assert array.features(state[None])[0][0] == pytest.approx(level, abs=1e-12)
    assert led_by_led(level).reshape(-1, 2) == pytest.approx(features_at(points, pose, mount), abs=1e-12)
    assert feature_jacobian(points, pose, mount) == pytest.approx(led_by_led(level_slopes), abs=1e-12)


def test_a_point_behind_the_camera_has_a_negative_depth(config: Config) -> None:
    array = LedArray(config.leds.points, config.camera.mount)
    _, depth = array.features(np.array([[-1.0, 0.0, 0.0], [4.0, 0.0, 0.0]]))
    assert (depth[0] < 0).all()
    assert (depth[1] > 0).all()
