"""Arms that hold the handle: angles and fingers that the tests of the arms share."""

from __future__ import annotations

from hypothesis import strategies as st

from common.config import Config
from common.geometry import Pose2
from common.timing import NS_PER_MS
from follower.arms.kinematics import grip_poses, make_arms
from follower.arms.sampling import SampleInterval

angles = st.floats(-2.5, 2.5)
joint_angles = st.tuples(angles, angles, angles)
GRIPPED, OPEN, EMPTY = (0.15, 0.15), (1.2, 1.2), (0.0, 0.15)
DT_S = 0.01
_time_ns = 0


def tick(cycles: int = 1) -> SampleInterval:
    """The next interval of 10 ms, or of several."""
    global _time_ns
    begin_ns, _time_ns = _time_ns, _time_ns + cycles * 10 * NS_PER_MS
    return SampleInterval(begin_ns, _time_ns)


def holding_angles(config: Config, x_m: float | None = None) -> tuple[float, ...]:
    handle = Pose2(config.arms.handle_x_m if x_m is None else x_m, 0.0, 0.0)
    poses = grip_poses(handle, config.arms.grip_half_width_m)
    left, right = (arm.solve(pose) for arm, pose in zip(make_arms(config.arms), poses, strict=True))
    return (*left, *right)
