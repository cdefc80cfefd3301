"""The simulated camera: renders one frame per exposure in the camera process, from the world message."""

from __future__ import annotations

from dataclasses import replace

from common.frames.ring import Image
from common.frames.source import Capture
from common.geometry import Pose2
from common.node import Inbox, NodeContext, Trigger
from common.timing import NS_PER_S
from sim.optics.image import Optics, View
from sim.optics.late_light import LateLight
from sim.optics.scenes import Scene, Walker, named_scene
from sim.truth import true_robots
from sim.world_config import world_config
from sim.world_message import WORLD


class SimulatedFrameSource:
    """A frame source that renders its images; exposure and gain come from the configuration.

    Not modelled: another motion blur when :meth:`expose` changes the exposure; only the brightness changes.
    """

    trigger = Trigger(wakes=(WORLD,))
    inputs = (WORLD,)

    def __init__(self, context: NodeContext) -> None:
        self._camera = context.config.camera
        world = world_config(context.config, str(context.config_path))
        true = true_robots(context.config, world.truth)
        self._optics = Optics(true.camera, true.leds, world.seed)
        self._late = LateLight(world.truth.drawn(len(context.config.leds.positions_m)).latency_ns)
        # the plant already tilts the camera by the uneven floor
        self._scene = self._named = replace(named_scene(world.scene, world.seed), shake_rad=(0.0, 0.0))
        self._exposure_us = self._camera.exposure_us

    def open(self) -> None:
        """Nothing to open."""

    def grab(self, now_ns: int, inputs: Inbox, image: Image) -> Capture | None:  # noqa: ARG002 - light has its own time
        """Render the newest exposure, if one came since the last step.

        Args:
            now_ns: not used; the world message carries its own time.
            inputs: with the world message.
            image: (height, width) uint8, written in place.
        """
        world = inputs.arrived(WORLD)
        if world is None:
            return None
        shown = self._late.seen_in(world)
        leader_in_follower = Pose2(shown.x_m, shown.y_m, shown.theta_rad).inverse()
        view = View(
            frame_sequence=world.sequence,
            relative=leader_in_follower,
            led_currents_a=shown.led_current_a,
            pitch_rad=shown.pitch_rad,
            roll_rad=shown.roll_rad,
            v_m_s=shown.v_m_s,
            w_rad_s=shown.w_rad_s,
            # counted from the world's start: lamps and walkers repeat in every run
            time_ns=round(world.sequence * NS_PER_S / self._camera.rate_hz),
            scene=self._with_occluders(world.occluders),
        )
        self._optics.render(image, view)
        return Capture(world.time_ns, self._exposure_us, self._camera.gain, "simulated")

    def expose(self, exposure_us: float) -> None:
        """Expose for ``exposure_us`` from the next frame on."""
        factor = self._named.exposure_factor * exposure_us / self._camera.exposure_us
        self._scene, self._exposure_us = replace(self._named, exposure_factor=factor), exposure_us

    def _with_occluders(self, occluders: tuple[tuple[float, float, float], ...]) -> Scene:
        if not occluders:
            return self._scene
        standing = tuple(Walker((x, y), (0.0, 0.0), 0.0, radius) for x, y, radius in occluders)
        return replace(self._scene, walkers=self._scene.walkers + standing)

    def close(self) -> None:
        """Nothing to close."""
