"""Configuration of a pair of robots: strict models, one TOML file, errors that name the file and the key."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from common.errors import ConfigError
from common.geometry import Array, Pinhole, Pose2, features_at, mirror_deviation_m

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Pair = tuple[float, float]
Xyz = tuple[float, float, float]


class Section(BaseModel):
    """Base of every table: frozen, strict about types, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class LensConfig(Section):
    """Intrinsics. ``coefficients`` in OpenCV's order: none, 8 for rational, 4 for fisheye."""

    model: Literal["pinhole", "rational", "fisheye"] = "pinhole"
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    coefficients: tuple[float, ...] = ()

    @model_validator(mode="after")
    def _coefficients_fit_model(self) -> LensConfig:
        wanted = {"pinhole": 0, "rational": 8, "fisheye": 4}[self.model]
        if len(self.coefficients) != wanted:
            raise ValueError(f"lens model {self.model!r} takes {wanted} coefficients, not {len(self.coefficients)}")
        return self


class CameraConfig(Section):
    """The Follower's camera: driver by name, image format, exposure and its place ξ on the robot.

    ``device`` says which one: the serial number (mindvision), ``/dev/video0`` (v4l2), a folder or video (replay);
    empty: the only one there is.
    ``mount_tilt_deg`` is how the camera is screwed on: pitch (up), roll (right side down), yaw (to the left).
    ``calibration`` is the file of ``davpc calibrate camera`` that ``lens`` was taken from, beside the configuration;
    ``davpc doctor`` compares the two, the camera and its age.
    """

    driver: str
    device: str = ""
    rate_hz: Annotated[float, Field(gt=0, le=500)]
    width_px: Annotated[int, Field(ge=64, le=8192)]
    height_px: Annotated[int, Field(ge=64, le=8192)]
    exposure_us: Annotated[float, Field(gt=0, le=100_000)]
    gain: Annotated[float, Field(gt=0, le=64)]
    mount_xyz_m: Xyz
    mount_tilt_deg: Xyz = (0.0, 0.0, 0.0)
    calibration: str = ""
    lens: LensConfig

    @cached_property
    def pinhole(self) -> Pinhole:
        """The lens without its distortion."""
        lens = self.lens
        return Pinhole(lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, self.width_px, self.height_px)

    @cached_property
    def mount(self) -> Array:
        """ξ, the optical centre in {F} [m]."""
        return np.array(self.mount_xyz_m)

    @cached_property
    def mount_tilt(self) -> Array:
        """Pitch, roll, yaw of the mounting [rad]."""
        return np.radians(self.mount_tilt_deg)


class BrightnessConfig(Section):
    """How bright one LED is in the image, from one look at it: what is far from it is no LED."""

    grey_per_us_at_1_m: Annotated[float, Field(gt=0, description="peak at 1 A, gain 1, on its axis, before clipping")]
    speck_px: Annotated[float, Field(gt=0, le=20, description="over which its image falls to 1/e, along a row")]
    factor: Annotated[float, Field(ge=2, description="up to which it may differ, both ways")]


class LedsConfig(Section):
    """The Leader's array: LED positions in {L}, beam and nominal current.

    Without ``brightness`` the absolute brightness of spots is not checked.
    """

    positions_m: Annotated[tuple[Xyz, ...], Field(min_length=4, max_length=12)]
    full_beam_deg: Annotated[float, Field(gt=0, le=180)]
    current_a: Annotated[float, Field(gt=0, le=5)]
    brightness: BrightnessConfig | None = None

    @cached_property
    def points(self) -> Array:
        """LED positions (n, 3) in {L} [m]."""
        return np.array(self.positions_m)

    @model_validator(mode="after")
    def _coplanar(self) -> LedsConfig:
        centred = self.points - self.points.mean(axis=0)
        singular = np.linalg.svd(centred, compute_uv=False)
        if singular[1] < 0.05:
            raise ValueError("the LEDs are collinear: the relative pose cannot be told from them")
        for a, b in combinations(range(len(self.points)), 2):
            if np.linalg.norm(self.points[a] - self.points[b]) < 0.04:
                raise ValueError(f"the LEDs {a} and {b} lie within 4 cm: from afar they are one spot")
        if len(self.points) == 4:
            for three in combinations(range(4), 3):
                _check_triangle(self.points[list(three)], three)
        if singular[2] > 0.02:
            raise ValueError("the LEDs are not coplanar: the homography of the paper does not exist")
        if mirror_deviation_m(self.points) < 0.05:
            raise ValueError(
                "the LEDs are symmetric: in a pane of glass the mirror image looks like the array itself"
            )
        return self


def _check_triangle(corners: Array, rows: tuple[int, ...]) -> None:
    """Of four LEDs any three must do when the other is hidden.

    Raises:
        ValueError: one lies within 4 cm of the line through the other two.
    """
    longest = max(float(np.linalg.norm(corners[i] - corners[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    if float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))) < 0.04 * longest:
        raise ValueError(f"the LEDs {', '.join(map(str, rows))} are collinear: alone they tell no pose")


class DockingConfig(Section):
    """Where trolley K docks, and when the approach counts as arrived.

    ``taught_dir`` holds the desired images of ``davpc teach K``; empty: geometry gives them.
    """

    goal_distance_m: Positive
    trolley_pitch_m: Positive
    staging_distance_m: Annotated[float, Field(gt=0, le=5, description="behind goal K, where a trolley is taken up")]
    feature_tolerance: Positive
    heading_tolerance_deg: Positive
    settle_s: Positive
    push_stroke_m: Positive
    lateral_bound_first_m: Positive
    lateral_bound_next_m: Positive
    taught_dir: str = ""

    def goal(self, trolley: int) -> Pose2:
        """Desired pose of {L} in {F} for docking ``trolley`` (1 is the first)."""
        return Pose2(self.goal_distance_m + self.trolley_pitch_m * (trolley - 1), 0.0, 0.0)


Quadruple = tuple[float, float, float, float]


class DisturbanceConfig(Section):
    """Disturbance states of the observer, in the order: speed gain, turn gain, yaw [rad/s], sideways [m/s]."""

    walk: Annotated[Quadruple, Field(description="random walk while driving, per root second")]
    onset_sigma: Annotated[Quadruple, Field(description="what a disturbance may be when one is detected")]
    quiet_sigma: Annotated[Quadruple, Field(description="what it may be otherwise")]
    bound: Annotated[Quadruple, Field(description="of the estimate")]


class EstimatorConfig(Section):
    """Perception and the filtered relative state."""

    method: Literal["paper", "davpc"]
    threshold: Annotated[int, Field(ge=1, le=254)]
    min_spot_px: Annotated[int, Field(ge=1)]
    max_spot_px: Annotated[int, Field(ge=4)]
    gate_px: Positive
    identification_residual_px: Positive
    coast_ms: Positive
    pixel_sigma_px: Positive
    process_noise: Annotated[tuple[float, float, float], Field(description="m, m, rad per root second")]
    distance_noise: Annotated[float, Field(ge=0, description="m, m, rad per root metre driven")]
    disturbance: DisturbanceConfig


class RealtimeConfig(Section):
    """The real-time predictive controller: 3 states, inputs linear between knots, one Gauss–Newton step a period."""

    horizon: Annotated[int, Field(ge=5, le=100)]
    knots: Annotated[tuple[int, ...], Field(min_length=3, description="steps at which inputs are free, from 0")]
    terminal_weight: Annotated[tuple[float, float, float], Field(description="of each α, each β, and θ")]
    effort_weight: Annotated[Pair, Field(description="of v² and ω², each step")]
    rate_weight: Annotated[Pair, Field(description="of Δv² and Δω², each step")]
    visibility_weight: Positive
    wheel_lag_ms: NonNegative
    cruise_m_s: Annotated[float, Field(gt=0, description="speed that is never exceeded, also below the limit")]
    rate_limit: Annotated[tuple[Positive, Positive], Field(description="Δv, Δω a period, also below the limit")]

    @model_validator(mode="after")
    def _knots_span_the_horizon(self) -> RealtimeConfig:
        rising = all(a < b for a, b in zip(self.knots, self.knots[1:], strict=False))
        if not rising or self.knots[0] != 0 or self.knots[-1] != self.horizon - 1:
            raise ValueError("knots rise from 0 to horizon - 1")
        return self


class CompensationConfig(Section):
    """The paper's extended state observer and what bounds its estimate."""

    bandwidth_rad_s: Positive
    observer_input: Literal["command", "wheel"]
    feature_bound: Annotated[float, Field(gt=0, description="of the disturbance of each feature, 1/s")]
    theta_bound_rad_s: Positive


class ControllerConfig(Section):
    """The predictive problem of the paper, eq. (nmpc_problem)."""

    method: Literal["paper", "davpc"]
    solver: str
    horizon: Annotated[int, Field(ge=5, le=100)]
    period_ms: Positive
    terminal_weight: NonNegative
    terminal_weight_theta: NonNegative
    effort_weight: Annotated[Pair, Field(description="R of v and ω")]
    visibility_margin_px: NonNegative
    deadline_ms: Positive
    realtime: RealtimeConfig
    compensation: CompensationConfig


class LimitsConfig(Section):
    """What the Follower may do: bounds of the controller and, above them, of the gate."""

    v_min_m_s: Annotated[float, Field(le=0, ge=-0.2)]
    v_max_m_s: Annotated[float, Field(gt=0, le=0.6)]
    w_max_rad_s: Annotated[float, Field(gt=0, le=0.8)]
    controller_dv_m_s: Positive
    controller_dw_rad_s: Positive
    gate_acceleration_m_s2: Annotated[float, Field(gt=0, le=0.6)]
    gate_angular_acceleration_rad_s2: Annotated[float, Field(gt=0, le=2.5)]


class SupervisorConfig(Section):
    """Phases of a docking: speeds, distances and how long each may take."""

    approach_speed_m_s: Annotated[float, Field(gt=0, le=0.6)]
    last_metre_speed_m_s: Annotated[float, Field(gt=0, le=0.2)]
    insert_speed_m_s: Annotated[float, Field(gt=0, le=0.05)]
    push_speed_m_s: Annotated[float, Field(gt=0, le=0.05)]
    push_limit_m: Positive
    retract_speed_m_s: Annotated[float, Field(gt=0, le=0.1)]
    retract_distance_m: Positive
    manual_speed_m_s: Annotated[float, Field(gt=0, le=0.1, description="most that a person may ask for by hand")] = (
        0.10
    )
    manual_turn_rad_s: Annotated[float, Field(gt=0, le=0.3)] = 0.30
    acquire_timeout_s: Positive
    approach_timeout_s: Positive
    lost_timeout_s: Positive
    stall_timeout_s: Annotated[Positive, Field(description="of an approach that comes no nearer")]
    lock_timeout_s: Annotated[float, Field(gt=0, le=60)]
    link_timeout_s: Annotated[float, Field(gt=0, le=60, description="for the Leader's word, in contact")]
    trolley_wait_s: Annotated[float, Field(gt=0, description="standing, before the grippers close")]
    grip_timeout_s: Positive
    trolley_timeout_s: Positive
    search_turn_deg: Annotated[float, Field(gt=0, le=45, description="to each side")]
    search_rate_rad_s: Annotated[float, Field(gt=0, le=0.3)]
    search_clearance_m: Annotated[float, Field(ge=0.3, description="to the goal, for turning with a trolley")]
    reduced_speed_m_s: Annotated[float, Field(gt=0, le=0.1, description="while a LED is missing")]
    reduced_sigma_m: Annotated[float, Field(gt=0, le=0.05, description="of e_y at the goal, with the LEDs left")]
    push_visual_tolerance_m: Positive


Degrees = tuple[float, float]


class ArmsConfig(Section):
    """Both SCARA arms, how they hold the handle, and what they take for contact, slip and collision.

    Geometry is the left arm's; the right one is its mirror image. Triples of gains are along the handle's
    x and y [N/m, N·s/m] and about its vertical [N·m/rad, N·m·s/rad], of one arm.
    """

    base_xy_m: Annotated[Pair, Field(description="shoulder of the left arm in {F}")]
    link_m: Annotated[tuple[Positive, Positive, Positive], Field(description="upper arm, forearm, wrist to grip")]
    joint_limits_deg: Annotated[tuple[Degrees, Degrees, Degrees], Field(description="of the left arm")]
    handle_x_m: Annotated[float, Field(description="handle in {F} while held")]
    retracted_x_m: Annotated[float, Field(description="grippers in {F} when they have let go")]
    grip_half_width_m: Positive
    held_stiffness: tuple[Positive, Positive, Positive]
    held_damping: tuple[Positive, Positive, Positive]
    free_stiffness: tuple[Positive, Positive, Positive]
    free_damping: tuple[Positive, Positive, Positive]
    joint_torque_limit_n_m: Positive
    pushing_force_n: Annotated[NonNegative, Field(description="most that is pushed ahead of the handle's yielding")]
    grip_torque_n_m: Positive
    release_torque_n_m: Annotated[float, Field(lt=0)]
    grip_empty_rad: Annotated[float, Field(description="below it the fingers hold nothing")]
    grip_closed_rad: Annotated[float, Field(description="below it they hold the handle")]
    grip_open_rad: Annotated[float, Field(description="above it they have let go")]
    slip_jump_rad: Positive
    contact_force_n: Positive
    connected_force_n: Positive
    inertia_allowance_kg: Annotated[NonNegative, Field(description="force allowed per acceleration before contact")]
    collision_torque_n_m: Positive
    collision_rate_n_m_s: Positive
    lift_height_m: NonNegative
    lift_travel_m: Annotated[NonNegative, Field(description="height when the grippers have let go")]

    @model_validator(mode="after")
    def _consistent(self) -> ArmsConfig:
        if self.connected_force_n <= self.contact_force_n:
            raise ValueError("connected_force_n must be greater than contact_force_n")
        if not self.grip_empty_rad < self.grip_closed_rad < self.grip_open_rad:
            raise ValueError("grip_empty_rad, grip_closed_rad, grip_open_rad must rise")
        if self.collision_torque_n_m >= self.joint_torque_limit_n_m:
            raise ValueError("collision_torque_n_m must be below joint_torque_limit_n_m, or no torque reaches it")
        return self


class HomingConfig(Section):
    """How an axis with an incremental encoder finds its place (CiA 402 mode 6). Units: rad, or m for the lift."""

    method: Annotated[int, Field(ge=-128, le=127, description="6098h, in the motor's direction")]
    position: Annotated[float, Field(description="where the axis stands at its home")]
    search_speed: Annotated[float, Field(gt=0, le=0.5, description="6099h:01, per second, towards the switch")]
    zero_speed: Annotated[float, Field(gt=0, le=0.5, description="6099h:02, per second, away from it")]
    acceleration: Annotated[float, Field(gt=0, le=5.0, description="609Ah, per second squared")]
    timeout_s: Annotated[float, Field(gt=0, le=120)] = 30.0


class DriveConfig(Section):
    """One CiA 402 drive on the bus."""

    node_id: Annotated[int, Field(ge=1, le=127)]
    counts_per_turn: Annotated[int, Field(ge=1)] = 65536
    gear_ratio: Positive = 1.0
    sign: Literal[1, -1] = 1
    zero_counts: Annotated[int, Field(ge=-(2**31), lt=2**31, description="absolute encoder at the axis' zero")] = 0
    rated_torque_n_m: Annotated[Positive, Field(description="of the motor, before the gear: 6076h")] = 0.5
    max_torque_permille: Annotated[int, Field(ge=0, le=3000, description="of the rated torque: 6072h")] = 1000
    serial: Annotated[int, Field(ge=0, lt=2**32, description="1018h:04; 0 takes any")] = 0
    homing: Annotated[HomingConfig | None, Field(description="none: an absolute encoder, read at start")] = None

    @model_validator(mode="after")
    def _one_zero(self) -> DriveConfig:
        if self.homing is not None and self.zero_counts:
            raise ValueError("zero_counts is of an absolute encoder: with homing the position at home says it")
        return self


class BusConfig(Section):
    """One CAN bus, as python-can names it."""

    interface: Literal["socketcan", "socketcand", "stepped"]
    channel: str
    host: str = ""
    port: Annotated[int, Field(ge=0, le=65535)] = 0
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 1_000_000


class FollowerCanConfig(Section):
    """The Follower's bus and who answers on it. EDS files lie beside the configuration."""

    bus: BusConfig
    master_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    drive_eds: str
    io_eds: str
    left_wheel: DriveConfig
    right_wheel: DriveConfig
    joints: Annotated[tuple[DriveConfig, ...], Field(min_length=6, max_length=6)]
    grippers: Annotated[tuple[DriveConfig, ...], Field(min_length=2, max_length=2)]
    lift: DriveConfig
    io_node_id: Annotated[int, Field(ge=1, le=127)]
    shadow: Annotated[bool, Field(description="never enable a drive; tell what would have been commanded")] = False
    readonly: Annotated[bool, Field(description="send nothing: follow what another master does on the bus")] = False
    watchdog_ms: Annotated[int, Field(ge=20, le=80)]
    wheel_ramp_m_s2: Annotated[float, Field(gt=0, le=1.0, description="the drives' own: 6083h to 6085h")]
    lift_lead_m: Annotated[Positive, Field(description="lift per turn of the lead screw")]
    lift_max_m: Annotated[float, Field(gt=0, le=1.0, description="travel of the lift: it is never told more")] = 1.0
    lift_speed_m_s: Annotated[float, Field(gt=0, le=0.1)]
    lift_acceleration_m_s2: Annotated[float, Field(gt=0, le=1.0)]

    @cached_property
    def drives(self) -> tuple[DriveConfig, ...]:
        """All eleven, in the order wheels, joints, grippers, lift."""
        return (self.left_wheel, self.right_wheel, *self.joints, *self.grippers, self.lift)

    @model_validator(mode="after")
    def _only_arms_are_homed(self) -> FollowerCanConfig:
        if any(drive.homing is not None for drive in (self.left_wheel, self.right_wheel, *self.grippers)):
            raise ValueError("homing is for joints and lift; wheels and grippers have none")
        return self

    @model_validator(mode="after")
    def _ids_differ(self) -> FollowerCanConfig:
        ids = [drive.node_id for drive in self.drives] + [self.io_node_id, self.master_node_id]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"node id {twice[0]} is given twice")
        return self


class LeaderCanConfig(Section):
    """The Leader's bus and its I/O module.

    When the Leader is silent for ``watchdog_ms`` the actuator stops where it is; the LEDs stay as they are.
    """

    bus: BusConfig
    master_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    io_node_id: Annotated[int, Field(ge=1, le=127)]
    io_eds: str
    watchdog_ms: Annotated[int, Field(ge=60, le=1000)]


class LeaderConfig(Section):
    """Guide, lock and LED driver of the Leader."""

    lock_travel_timeout_s: Positive
    lock_travel_least_s: Annotated[
        NonNegative, Field(description="before it a closing bolt cannot be there: a switch that says so is stuck")
    ] = 0.5
    actuator_current_limit_a: Positive
    led_current_tolerance_a: Positive
    led_rated_current_a: Annotated[Positive, Field(description="that an LED bears for ever")]
    led_max_current_a: Annotated[float, Field(gt=0, le=5, description="that may be asked for")]
    led_thermal_s: Annotated[Positive, Field(description="time constant of an LED's heat")]

    @model_validator(mode="after")
    def _travel_in_time(self) -> LeaderConfig:
        if self.lock_travel_least_s >= self.lock_travel_timeout_s:
            raise ValueError("lock_travel_least_s must be less than lock_travel_timeout_s")
        return self


class BaseConfig(Section):
    """The Follower's differential drive, and its battery: 0 V as a bound means that it is not judged.

    Below ``battery_low_v`` the doctor asks for a charge; below ``battery_min_v`` nothing is armed, a docking pauses.
    """

    wheel_radius_m: Positive
    track_m: Positive
    latency_ms: NonNegative
    battery_low_v: NonNegative = 0.0
    battery_min_v: NonNegative = 0.0

    @model_validator(mode="after")
    def _charge_before_the_end(self) -> BaseConfig:
        if self.battery_low_v and self.battery_min_v > self.battery_low_v:
            raise ValueError("battery_min_v is above battery_low_v: it would stop before it asks for a charge")
        return self


DEFAULT_NAMESPACE = "davpc"
CertificateName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]{0,62}$")]
NetworkAddress = Annotated[str, Field(pattern=r"^quic/(\[[0-9a-f:]+\]|[A-Za-z0-9.-]+):[0-9]{1,5}$")]


class GatewayConfig(Section):
    """One robot's gateway: the common name of its certificate, and its addresses, as ``quic/host:port``."""

    certificate: CertificateName
    listen: tuple[NetworkAddress, ...] = ()
    connect: tuple[NetworkAddress, ...] = ()


class NetworkConfig(Section):
    """What crosses between the robots, and whom their gateways let in.

    ``namespace`` is this pair's on the site's network. ``credentials`` holds ``ca.pem`` and, for each certificate,
    ``NAME.pem`` and ``NAME.key``. ``site_router`` is its certificate if both robots connect to one, instead of to
    each other. ``operators`` are certificates that may watch, and change nothing.
    """

    namespace: Annotated[str, Field(pattern=r"^[a-z0-9_-]+(/[a-z0-9_-]+)*$")] = DEFAULT_NAMESPACE
    credentials: str = "/etc/davpc/pki"
    max_message_bytes: Annotated[int, Field(ge=4096, le=1_048_576)] = 65_536
    follower: GatewayConfig = GatewayConfig(
        certificate="follower", listen=("quic/0.0.0.0:7447",), connect=("quic/leader:7447",)
    )
    leader: GatewayConfig = GatewayConfig(
        certificate="leader", listen=("quic/0.0.0.0:7447",), connect=("quic/follower:7447",)
    )
    site_router: CertificateName | None = None
    operators: tuple[CertificateName, ...] = ()

    def of(self, robot: Literal["follower", "leader"]) -> GatewayConfig:
        """The gateway of one of the two."""
        return self.follower if robot == "follower" else self.leader

    @model_validator(mode="after")
    def _names_differ(self) -> NetworkConfig:
        names = [self.follower.certificate, self.leader.certificate, *self.operators]
        names += [self.site_router] if self.site_router else []
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"certificate {twice[0]!r} is given twice: each has its own rights")
        return self


class Config(Section):
    """Everything that both robots read. ``world`` belongs to the simulated backend, which checks it itself.

    ``state_directory`` is where a robot keeps what outlives its processes: the queue's count, reports of attempts;
    empty: systemd's, or the runtime directory.
    """

    state_directory: str = ""
    base: BaseConfig
    camera: CameraConfig
    leds: LedsConfig
    docking: DockingConfig
    estimator: EstimatorConfig
    controller: ControllerConfig
    limits: LimitsConfig
    supervisor: SupervisorConfig
    arms: ArmsConfig
    follower_can: FollowerCanConfig
    leader_can: LeaderCanConfig
    leader: LeaderConfig
    network: NetworkConfig = NetworkConfig()
    world: dict[str, Any] = {}

    @model_validator(mode="after")
    def _fits_together(self) -> Config:
        limits, phases = self.limits, self.supervisor
        if phases.approach_speed_m_s > limits.v_max_m_s:
            raise ValueError("supervisor.approach_speed_m_s is more than limits.v_max_m_s")
        if phases.retract_speed_m_s > -limits.v_min_m_s:
            raise ValueError("supervisor.retract_speed_m_s is more than limits.v_min_m_s allows backwards")
        if not self.leds.current_a <= self.leader.led_rated_current_a <= self.leader.led_max_current_a:
            raise ValueError("leds.current_a ≤ leader.led_rated_current_a ≤ leader.led_max_current_a does not hold")
        if phases.push_limit_m <= self.docking.push_stroke_m:
            raise ValueError("supervisor.push_limit_m must be more than docking.push_stroke_m")
        if self.controller.method == "paper" and self.controller.solver == "gauss_newton":
            raise ValueError('controller.method "paper" predicts features: its solver is "fatrop" or "ipopt"')
        # the controller steps on every third state
        if abs(self.controller.period_ms * self.camera.rate_hz / 3000.0 - 1.0) > 0.02:
            raise ValueError("controller.period_ms must be three frame periods, 3000 / camera.rate_hz")
        camera = self.camera
        pixels = camera.pinhole.to_pixels(features_at(self.leds.points, self.docking.goal(1), camera.mount))
        inside = (pixels >= 0) & (pixels <= [camera.width_px - 1, camera.height_px - 1])
        if not inside.all():
            raise ValueError("at the goal of trolley 1 a LED lies outside the image: check camera.mount_xyz_m, leds")
        if np.any(np.abs(camera.mount[2] - self.leds.points[:, 2]) < 0.02):
            raise ValueError("a LED is as high as the camera (Δh = 0): its depth cannot be told")
        return self


M = TypeVar("M", bound=BaseModel)


def load_config(path: Path, overrides: Sequence[str] = ()) -> Config:
    """Read the pair's configuration.

    Args:
        path: TOML file.
        overrides: ``table.key=value`` with a TOML value, applied after the file.

    Raises:
        ConfigError: the file is missing or not TOML, a key is unknown, a value out of range.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    for override in overrides:
        _apply(table, override)
    return validate(Config, table, str(path))


def validate(model: type[M], table: Mapping[str, Any], origin: str) -> M:
    """Check a table against its model; ``origin`` (a file, or a file and a table) goes into the error.

    Raises:
        ConfigError: with one line for the first fault, and the number of further ones.
    """
    try:
        return model.model_validate(_tuples(table))
    except ValidationError as error:
        faults = error.errors()
        first = faults[0]
        key = ".".join(str(part) for part in first["loc"]) or "(whole file)"
        what = first["msg"].removeprefix("Value error, ")
        if first["type"] == "extra_forbidden":
            what = "unknown key"
        elif first["type"] != "missing" and not isinstance(first["input"], dict | tuple | BaseModel):
            what = f"{what}, got {first['input']!r}"
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ConfigError(f"{origin}: {key}: {what}{more}") from error


def default_config_path() -> Path:
    """``/etc/davpc/robots.toml`` on a robot, else the reference robots that come with davpc."""
    package = Path(__file__).resolve().parent
    installed = Path("/etc/davpc/robots.toml")
    candidates = [
        installed,
        package.parent / "deploy/config/robots.toml",
        package / "default_config/robots.toml",
    ]
    return next((path for path in candidates if path.exists()), installed)


def _apply(table: dict[str, Any], override: str) -> None:
    key, separator, value = override.partition("=")
    if not separator:
        raise ConfigError(f"override {override!r}: write it as table.key=value")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value
    *parents, last = key.strip().split(".")
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise ConfigError(f"override {override!r}: {parent} is not a table")
    table[last] = parsed


def _tuples(value: Any) -> Any:
    """TOML arrays as tuples, the immutable form that the models hold."""
    if isinstance(value, Mapping):
        return {key: _tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    return value
