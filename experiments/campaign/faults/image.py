"""Faults of the camera, of its images, of the LEDs and of the Leader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from common.errors import DeviceError
from common.timing import NS_PER_MS
from experiments.campaign.stage import Stage

_AHEAD_M, _RADIUS_M = 1.9, 0.45
_HIDDEN_S = 1.0
_HUNG_S = 0.4


def hide_leds(stage: Stage, for_s: float) -> None:
    """Something stands between the robots."""
    pose = stage.plant.pose
    # never behind the array: half way where that is near
    ahead_m = min(_AHEAD_M, -0.5 * pose.x_m)
    stage.plant.occluders = ((pose.x_m + ahead_m, 0.5 * pose.y_m, min(_RADIUS_M, 0.6 * ahead_m)),)
    stage.later(for_s, lambda: setattr(stage.plant, "occluders", ()))


def _halt(name: str, for_s: float | None = None, blind: bool = False) -> Callable[[Stage], None]:
    def fault(stage: Stage) -> None:
        stage.executor.halt(name)
        if blind and for_s is None and stage.trace is not None:
            stage.trace.blind_ns = stage.clock.now_ns()
        if for_s is not None:
            stage.later(for_s, lambda: stage.executor.resume(name))

    return fault


def _spoilt(spoil: Callable[[Stage, Any, Any], Any], blind: bool = True) -> Callable[[Stage], None]:
    """Every image from now on passes through ``spoil(stage, pixels, capture)``, which returns the capture."""

    def fault(stage: Stage) -> None:
        source = stage.node("follower-camera")._source
        grab = source.grab
        if blind and stage.trace is not None:
            stage.trace.blind_ns = stage.clock.now_ns()

        def spoilt(now_ns: int, inputs: Any, slot: Any) -> Any:
            capture = grab(now_ns, inputs, slot)
            return None if capture is None else spoil(stage, slot, capture)

        source.grab = spoilt

    return fault


def _unplugged(_stage: Stage, _slot: Any, _capture: Any) -> Any:
    raise DeviceError("camera: unplugged")


def _late(_stage: Stage, _slot: Any, capture: Any) -> Any:
    return replace(capture, capture_ns=max(0, capture.capture_ns - 150 * NS_PER_MS))


def _frozen(noise: int) -> Callable[[Stage], None]:
    def fault(stage: Stage) -> None:
        kept: list[Any] = []
        draws = np.random.default_rng(stage.random.randrange(2**31))

        def spoil(_stage: Stage, slot: Any, capture: Any) -> Any:
            if not kept:
                kept.append(slot.copy())
            slot[:] = kept[0]
            if noise:
                grain = draws.integers(-noise, noise + 1, slot.shape, dtype=np.int16)
                slot[:] = np.clip(kept[0].astype(np.int16) + grain, 0, 255).astype(np.uint8)
            return capture

        _spoilt(spoil)(stage)

    return fault


def _over(_stage: Stage, slot: Any, capture: Any) -> Any:
    slot[slot.shape[0] // 4 :] = 255
    return capture


def _under(_stage: Stage, slot: Any, capture: Any) -> Any:
    slot[:] = 0
    return capture


def _second_array(_stage: Stage, slot: Any, capture: Any) -> Any:
    """The same four spots again, beside the true ones."""
    slot[:] = np.maximum(slot, np.roll(slot, 150, axis=1))
    return capture


def _blobs(stage: Stage, slot: Any, capture: Any) -> Any:
    """Thirty bright reflections, at other places in every frame."""
    height, width = slot.shape
    for _ in range(30):
        u, v = stage.random.randrange(4, width - 4), stage.random.randrange(4, height - 4)
        slot[v - 2 : v + 3, u - 2 : u + 3] = 200
    return capture


def _led_dead(count: int) -> Callable[[Stage], None]:
    def fault(stage: Stage) -> None:
        leds = stage.random.sample(range(len(stage.config.leds.points)), count)
        stage.plant.leader.faults.dead_leds.update(leds)

    return fault


def _leader_off(stage: Stage) -> None:
    stage.plant.leader.faults.powered = False
    stage.executor.halt("leader")


def _bolt_blocked(stage: Stage) -> None:
    stage.plant.leader.faults.bolt_blocked = True


def _switch_closed(stage: Stage) -> None:
    stage.plant.leader.faults.stuck["lock_extended"] = True


FAULTS: dict[str, Callable[[Stage], None]] = {
    "camera_dead": _halt("follower-camera", blind=True),
    "camera_hung": _halt("follower-camera", _HUNG_S),
    "camera_unplugged": _spoilt(_unplugged),
    "frames_late": _spoilt(_late),
    "frozen": _frozen(0),
    "frozen_noisy": _frozen(1),
    "overexposed": _spoilt(_over),
    "underexposed": _spoilt(_under),
    "second_array": _spoilt(_second_array, blind=False),
    "false_blobs": _spoilt(_blobs, blind=False),
    "led_dead": _led_dead(1),
    "leds_dead": _led_dead(2),
    "leds_hidden": lambda stage: hide_leds(stage, _HIDDEN_S),
    "leader_off": _leader_off,
    "bolt_blocked": _bolt_blocked,
    "switch_closed": _switch_closed,
}
