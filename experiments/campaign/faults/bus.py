"""Faults of drives, encoders, wires, battery, wheels and of what the robot meets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from experiments.campaign.stage import Stage

_BRIEF_S = 0.5


def _trip(group: str) -> Callable[[Stage], None]:
    """A drive of the group reports an overcurrent."""

    def fault(stage: Stage) -> None:
        _one(stage, group).trip(0x2310, 0x02)

    return fault


def _one(stage: Stage, group: str) -> Any:
    follower = stage.follower
    wheels = (follower.left_wheel, follower.right_wheel)
    return stage.random.choice({"wheel": wheels, "joint": follower.joints, "grip": follower.grippers}[group])


def _silent(group: str) -> Callable[[Stage], None]:
    def fault(stage: Stage) -> None:
        silent: set[int] = stage.follower.bus.faults.silent
        silent.add(_one(stage, group).node_id)
        stage.later(_BRIEF_S, silent.clear)

    return fault


def _marked(kind: str) -> Callable[[Stage], None]:
    """For half a second the frames of one wheel are ``truncated`` or ``replayed``."""

    def fault(stage: Stage) -> None:
        nodes: set[int] = getattr(stage.follower.bus.faults, kind)
        nodes.add(_one(stage, "wheel").node_id)
        stage.later(_BRIEF_S, nodes.clear)

    return fault


def _bus_off(for_s: float | None) -> Callable[[Stage], None]:
    def fault(stage: Stage) -> None:
        faults = stage.follower.bus.faults
        faults.bus_off = True
        if for_s is not None:
            stage.later(for_s, lambda: setattr(faults, "bus_off", False))

    return fault


def _encoder(seen: Callable[[float, float, float], tuple[float, float]]) -> Callable[[Stage], None]:
    """A wheel's encoder tells ``seen(angle, speed, angle at the fault)``."""

    def fault(stage: Stage) -> None:
        encoder = _one(stage, "wheel").encoder
        begin: list[float] = []

        def read(position: float, velocity: float) -> tuple[float, float]:
            begin[:] = begin or [position]
            return seen(position, velocity, begin[0])

        encoder.read = read

    return fault


def _joint_jump(stage: Stage) -> None:
    _one(stage, "joint").encoder.jump = 0.5


def _misread(stage: Stage) -> None:
    """Both wheels report 1.6 times their way and speed for 2 s; then the LEDs are hidden."""
    for wheel in (stage.follower.left_wheel, stage.follower.right_wheel):
        begin: list[float] = []

        def read(position: float, velocity: float, begin: list[float] = begin) -> tuple[float, float]:
            begin[:] = begin or [position]
            return begin[0] + 1.6 * (position - begin[0]), 1.6 * velocity

        wheel.encoder.read = read


def _torque_spike(stage: Stage) -> None:
    """One joint's torque reads 30 N·m more than it is."""
    joint = _one(stage, "joint")
    sampled = joint.sampled

    def spiked() -> None:
        sampled()
        torque = joint.values[0x6077, 0] + round(30.0 * joint._permille_per_n_m)
        joint.values[0x6077, 0] = max(-32768, min(32767, torque))

    joint.sampled = spiked


def _obstacle(stage: Stage) -> None:
    """The trolley's front meets something that does not yield."""
    contact = stage.plant.contact
    contact.jam_m = contact.queue.mouth_x_m() - contact.trolley.beam_x_m


def _wheel_blocked(stage: Stage) -> None:
    plant = stage.plant
    roll = plant._roll

    def blocked(dt_s: float) -> None:
        plant._wheel_target = (0.0, plant._wheel_target[1])
        plant._wheel_speed[0] = 0.0
        roll(dt_s)

    plant._roll = blocked


def _slip(*sides: int) -> Callable[[Stage], None]:
    """The fingers close past the handle."""

    def fault(stage: Stage) -> None:
        for side in sides:
            stage.plant.arms.grippers[side].slippery = True

    return fault


FAULTS: dict[str, Callable[[Stage], None]] = {
    "wheel_fault": _trip("wheel"),
    "joint_fault": _trip("joint"),
    "gripper_fault": _trip("grip"),
    "wheel_silent": _silent("wheel"),
    "joint_silent": _silent("joint"),
    "can_truncated": _marked("truncated"),
    "can_replayed": _marked("replayed"),
    "bus_off": _bus_off(None),
    "bus_off_briefly": _bus_off(_BRIEF_S),
    "angle_stuck": _encoder(lambda _angle, speed, begin: (begin, speed)),
    "speed_stuck": _encoder(lambda angle, _speed, _begin: (angle, 0.0)),
    "angle_jump": _encoder(lambda angle, speed, _begin: (angle + 2.0, speed)),
    "sign_flip": _encoder(lambda angle, speed, begin: (2.0 * begin - angle, -speed)),
    "angle_backwards": _encoder(lambda angle, speed, begin: (2.0 * begin - angle, speed)),
    "angle_half": _encoder(lambda angle, speed, begin: (begin + 0.5 * (angle - begin), speed)),
    "joint_jump": _joint_jump,
    "wheels_misread": _misread,
    "torque_spike": _torque_spike,
    "obstacle": _obstacle,
    "wheels_slip": lambda stage: setattr(stage.plant, "floor_grip", 0.0),
    "wheel_blocked": _wheel_blocked,
    "one_hand_slips": _slip(0),
    "both_hands_slip": _slip(0, 1),
    "estop": lambda stage: stage.follower.set_stop_inputs(False, True),
    "protective_stop": lambda stage: stage.follower.set_stop_inputs(True, False),
    "battery_low": lambda stage: stage.follower.set_battery(21.0),
}
