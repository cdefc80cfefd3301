"""One simulated SCARA arm: three joints with inertia, viscous and dry friction and a hard stop at each limit."""

from __future__ import annotations

import math

import numpy as np

from common.config import ArmsConfig
from common.errors import ConfigError
from sim.world_config import WorldConfig

Triple = tuple[float, float, float]


class ScaraPlant:
    """One arm: joint angles and speeds, with its own geometry and friction. ``side``: 1 left, −1 right."""

    def __init__(self, config: ArmsConfig, world: WorldConfig, side: int) -> None:
        grown = 1.0 + world.link_error
        self.base = (config.base_xy_m[0], side * config.base_xy_m[1])
        self.links = tuple(grown * length for length in config.link_m)
        limits = [sorted((side * math.radians(a), side * math.radians(b))) for a, b in config.joint_limits_deg]
        self.low, self.high = [pair[0] for pair in limits], [pair[1] for pair in limits]
        self.inertia, self.friction = world.joint_inertia_kg_m2, world.joint_friction_n_m
        self.damping = world.joint_damping_n_m_s
        self.angles = [side * 1.2, side * -1.6, side * 0.4]
        self.speeds = [0.0, 0.0, 0.0]

    def tip(self) -> tuple[Triple, tuple[Triple, Triple]]:
        """Gripper pose in {F} (m, m, rad); rows x and y of its Jacobian by the three joint angles."""
        a1, a2, a3 = self.angles
        h2, h3 = a1 + a2, a1 + a2 + a3
        l1, l2, l3 = self.links
        x3, y3 = l3 * math.cos(h3), l3 * math.sin(h3)
        x2, y2 = x3 + l2 * math.cos(h2), y3 + l2 * math.sin(h2)
        x1, y1 = x2 + l1 * math.cos(a1), y2 + l1 * math.sin(a1)
        return (self.base[0] + x1, self.base[1] + y1, h3), ((-y1, -y2, -y3), (x1, x2, x3))

    def place(self, grip_in_follower: Triple) -> None:
        """Bend the joints until the gripper is at a pose in {F} (m, m, rad): Newton's method from where it is.

        Raises:
            ConfigError: the joints cannot bring it there.
        """
        for _ in range(60):
            (x, y, heading), (by_x, by_y) = self.tip()
            error = grip_in_follower[0] - x, grip_in_follower[1] - y, grip_in_follower[2] - heading
            if max(map(abs, error)) < 1e-10:
                return
            steps = np.linalg.lstsq(np.array([by_x, by_y, (1.0, 1.0, 1.0)]), np.array(error), rcond=1e-3)[0]
            scale = min(1.0, 0.3 / float(np.abs(steps).max()))
            self.angles = [angle + scale * float(step) for angle, step in zip(self.angles, steps, strict=True)]
        raise ConfigError("world.handle_x_m: the simulated arms cannot reach the handle; check arms.link_m too")

    def move(self, torques: Triple, dt_s: float) -> None:
        """One step under motor and handle torques; dry friction stops a joint but never drives it."""
        for i, torque in enumerate(torques):
            speed = self.speeds[i] + (torque - self.damping * self.speeds[i]) / self.inertia[i] * dt_s
            loss = self.friction / self.inertia[i] * dt_s
            speed = math.copysign(max(0.0, abs(speed) - loss), speed)
            angle = self.angles[i] + speed * dt_s
            if not self.low[i] <= angle <= self.high[i]:
                angle, speed = min(self.high[i], max(self.low[i], angle)), 0.0
            self.angles[i], self.speeds[i] = angle, speed
