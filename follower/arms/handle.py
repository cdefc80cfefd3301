"""Both arms at the handle: measurements and mission in, arm state and set-points out."""

from __future__ import annotations

import math

from common.config import ArmsConfig, BaseConfig
from common.geometry import Pose2
from common.kinematics import twist_from_wheels
from common.messages import ArmCause, ArmSetpoint, ArmState, Drives, Mission
from common.timing import NS_PER_MS
from follower.arms.collision_detection import CollisionDetector
from follower.arms.contact_detection import ContactDetector
from follower.arms.grasp import GraspSequence
from follower.arms.impedance import HandleImpedance
from follower.arms.posture import Posture, PostureTracker, handle_force
from follower.arms.sampling import SampleInterval
from follower.arms.slip_detection import SlipDetector
from follower.standstill import BRAKING_NS, Standstill

# what lasts is not judged across a gap: a longer one counts for this much
_LONGEST_STEP_NS = 50 * NS_PER_MS
_PUSH_N_S = 60.0
# below one: dry friction in the joints would hold a full push, which would then be learned as resistance
_PUSH_SHARE = 0.7
_DRIVING_M_S = 0.01
_ACCELERATION_FILTER_S = 0.05
# how fast a handle that stands askew when the drives are enabled is brought in line with the chassis
_STRAIGHTEN_M_S, _STRAIGHTEN_RAD_S = 0.03, 0.06
# the highest that a set-point may name; a lift that reads higher is held there, which the bridge limits further
_HIGHEST_LIFT_M = 2.0


class HandleHold:
    """Steps at 100 Hz with each measurement of the drives; :meth:`feel` first, then :meth:`hold`.

    A slip or a collision is reported until the next epoch, and the arms yield at once: reference where the handle
    is, gains of free arms, no push. The supervisor reacts within its own period.

    After a stop they go on under the epoch that was armed until the base stands: until then the bridge follows them.
    """

    def __init__(self, arms: ArmsConfig, base: BaseConfig) -> None:
        self._config, self._base = arms, base
        self._tracker = PostureTracker(arms)
        self._impedance = HandleImpedance(arms)
        self._grasp = GraspSequence(arms)
        self._contact = ContactDetector(arms)
        self._collision, self._slip = CollisionDetector(arms), SlipDetector(arms)
        self._posture: Posture | None = None
        self._measured_ns: int | None = None
        self._interval = SampleInterval(0, 0)
        self._speed_m_s = self._acceleration_m_s2 = 0.0
        self._push_n = 0.0
        self._askew = 0.0, 0.0
        self._holding = False
        self._epoch = -1
        self._cause: ArmCause = "ok"
        self._standstill = Standstill(base)
        self._armed_ns: int | None = None
        self.led = False

    def feel(self, drives: Drives, mission: Mission | None) -> ArmState:
        """Force along the handle from all six joint torques, contact, connection, slip, collision."""
        self._time(drives)
        self._lead(drives)
        posture = self._tracker.posture(drives.joint_angle_rad, drives.measured_ns)
        self._posture = posture
        force_n = float(handle_force(posture, drives.joint_torque_n_m)[0])
        ahead = drives.v_set_m_s > _DRIVING_M_S and drives.state == "armed" and self._holding
        expected = mission is not None and mission.contact_expected
        self._contact.step(force_n, self._acceleration_m_s2, self._interval, rolling=ahead, expected=expected)
        if mission is not None and mission.epoch != self._epoch:
            self._epoch, self._cause = mission.epoch, "ok"
        self._watch(drives)
        return ArmState(
            handle_force_n=max(-5000.0, min(5000.0, self._contact.force_n)),
            contact=self._contact.contact,
            connected=self._contact.connected,
            gripped=self._grasp.gripped(drives.grip_angle_rad),
            released=self._grasp.released(drives.grip_angle_rad),
            cause=self._cause,
            resistance_n=self._contact.resistance_n,
        )

    def hold(self, drives: Drives, mission: Mission) -> ArmSetpoint:
        """Set-points after :meth:`feel` of the same measurement.

        Raises:
            RuntimeError: nothing was felt yet.
        """
        posture = self._posture
        if posture is None:
            raise RuntimeError("hold() comes after feel()")
        # after a stop nothing is pressed on: a trolley that rolls freely is held, one that touches something is not
        pressing = drives.state != "armed" and (self._contact.contact or self._contact.connected)
        obeyed = self.led and self._cause == "ok" and not pressing
        if not self.led:
            self._grasp.restart(posture.handle.x_m, drives.grip_angle_rad, drives.lift_m, self._interval.begin_ns)
            self._askew = posture.handle.y_m, posture.handle.theta_rad
        if mission.phase == "manual" or mission.grip == "stay":
            grasp = self._grasp.in_place(mission.grip, mission.lift_m, drives.grip_angle_rad, self._interval)
        else:
            grasp = self._grasp.step(mission.grip, drives.grip_angle_rad, drives.lift_m, self._interval)
            self._straighten()
        self._holding = grasp.stage == "hold"
        self._push(drives, obeyed and self._holding)
        reference = Pose2(grasp.handle_x_m, *self._askew) if obeyed else posture.handle
        torques = self._impedance.torques(posture, reference, self._push_n, grasp.firmness if obeyed else 0.0)
        grip = grasp.grip_torque_n_m
        epoch = drives.epoch if self.led else mission.epoch
        return ArmSetpoint(epoch, torques, (grip, grip), min(max(grasp.lift_m, 0.0), _HIGHEST_LIFT_M))

    def _lead(self, drives: Drives) -> None:
        """Whether the drives follow: while they are armed, and from then on until the base stands."""
        now_ns = drives.measured_ns
        self._standstill.step(now_ns, drives)
        if drives.state == "armed":
            self._armed_ns, self.led = now_ns, True
            return
        braking = self._armed_ns is not None and now_ns - self._armed_ns < BRAKING_NS and not self._standstill.holds
        self.led = self.led and drives.state in ("stopped", "disarmed") and braking

    def _straighten(self) -> None:
        """Bring the reference in line with the chassis without a jump, which would count as a collision."""
        dt_s = self._interval.dt_s
        steps = _STRAIGHTEN_M_S * dt_s, _STRAIGHTEN_RAD_S * dt_s
        aside_m, turned_rad = (
            math.copysign(max(0.0, abs(value) - step), value) for value, step in zip(self._askew, steps, strict=True)
        )
        self._askew = aside_m, turned_rad

    def _time(self, drives: Drives) -> None:
        """Step length and acceleration from the measurement's own stamps."""
        speed, _ = twist_from_wheels(self._base, drives.wheel_speed_rad_s)
        if self._measured_ns is None:
            self._measured_ns, self._speed_m_s = drives.measured_ns, speed
        elapsed_ns = drives.measured_ns - self._measured_ns
        before_ns = self._interval.end_ns
        self._interval = SampleInterval(before_ns, before_ns + min(max(elapsed_ns, 0), _LONGEST_STEP_NS))
        dt_s = self._interval.dt_s
        if dt_s > 0.0:
            share = min(1.0, dt_s / _ACCELERATION_FILTER_S)
            raw = (speed - self._speed_m_s) / dt_s
            self._acceleration_m_s2 += share * (raw - self._acceleration_m_s2)
            self._speed_m_s = speed
        self._measured_ns = max(self._measured_ns, drives.measured_ns)

    def _watch(self, drives: Drives) -> None:
        """Slip and collision are judged while the drives really obey and a trolley is held."""
        if not self.led or drives.shadow or not self._holding:
            self._slip.forget()
            self._collision.forget()
            return
        if self._interval.dt_s <= 0.0:
            return
        slipped = self._slip.step(drives.grip_angle_rad, drives.grip_torque_n_m, self._interval)
        if self._slip.suspected:
            # an arm that loses its load jumps: this is no collision
            self._collision.forget()
        collided = self._collision.step(drives.joint_torque_n_m, self._interval.end_ns)
        if collided:
            self._cause = "collision"
        elif slipped and self._cause == "ok":
            self._cause = "slip"

    def _push(self, drives: Drives, allowed: bool) -> None:
        """F_push: the resistance that was measured, in the commanded direction, taken up smoothly."""
        wanted = _PUSH_SHARE * self._contact.resistance_n if allowed and drives.v_set_m_s > _DRIVING_M_S else 0.0
        if drives.state != "armed" or self._cause != "ok":
            self._push_n = 0.0
        step_n = _PUSH_N_S * self._interval.dt_s
        self._push_n += min(step_n, max(-step_n, wanted - self._push_n))
