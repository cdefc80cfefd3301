"""Publishes the messages of estimator, supervisor and arms, for the bench of the stop times."""

from __future__ import annotations

import secrets
import threading
from typing import Any

from common.bus import Bus
from common.channels import ARM_SETPOINT, DOCKING_STATE, MISSION, Channel
from common.config import Config
from common.messages import ArmSetpoint, DockingState, Message, Mission
from common.node import Outbox
from common.timing import NS_PER_S, MonotonicClock

SPEED_M_S = 0.3
_FEED_PERIOD_NS = NS_PER_S // 120


class Feeder:
    """Publishes docking states at 60 Hz, missions at 20 Hz, arm set-points at 120 Hz."""

    def __init__(self, bus: Bus, config: Config) -> None:
        self._bus, self._config = bus, config
        self._clock = MonotonicClock()
        names = ("follower-estimator", "follower-supervisor", "follower-arms")
        self._out = {name: Outbox(name, secrets.randbits(62), self._clock.boot_id) for name in names}
        self.epoch = 0
        self.armed = False
        self._beats = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._feed, name="feeder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _feed(self) -> None:
        due_ns = self._clock.now_ns()
        while not self._stop.is_set():
            self._clock.sleep_until(due_ns)
            now_ns = self._clock.now_ns()
            due_ns = max(due_ns + _FEED_PERIOD_NS, now_ns)
            self._beats += 1
            self._send("follower-arms", ARM_SETPOINT, ArmSetpoint(self.epoch, (0.0,) * 6, (0.0, 0.0), 0.2), 1)
            self._send("follower-estimator", DOCKING_STATE, self._state(now_ns), 2)
            self._send("follower-supervisor", MISSION, self._mission(), 6)

    def _send(self, source: str, channel: Channel[Any], message: Message, every: int) -> None:
        if self._beats % every == 0:
            self._bus.publish(channel, self._out[source].pack(channel, message, self._clock.now_ns()))

    def _state(self, now_ns: int) -> DockingState:
        goal, count = self._config.docking.goal(1), len(self._config.leds.positions_m)
        return DockingState(
            frame_sequence=self._beats,
            capture_ns=now_ns,
            valid=True,
            cause="ok",
            leds_seen=count,
            features=((0.0, 0.0),) * count,
            features_filtered=((0.0, 0.0),) * count,
            theta_homography_rad=None,
            x_m=goal.x_m + 4.0,
            y_m=0.0,
            theta_rad=0.0,
            covariance=(0.0,) * 9,
            disturbance=(0.0,) * 4,
            fit=None,
            fit_covariance=None,
            residual_px=0.0,
            spots=count,
            frames_seen=self._beats,
            frames_dropped=0,
        )

    def _mission(self) -> Mission:
        goal = self._config.docking.goal(1)
        return Mission(
            phase="approach",
            cause="",
            trolley=1,
            epoch=self.epoch,
            armed=self.armed,
            motion="straight",
            straight_speed_m_s=SPEED_M_S,
            v_max_m_s=SPEED_M_S,
            w_max_rad_s=0.5,
            goal_theta_rad=goal.theta_rad,
            desired_features=(),
            grip="closed",
            contact_expected=False,
            resets=0,
        )
