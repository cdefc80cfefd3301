"""What a viewer draws: poses, LEDs and image as the well-known schemas of Foxglove, in Protocol Buffers.

Frames: ``leader`` is {L}; ``follower`` is {F} as estimated, ``camera`` is {C} on it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CircleAnnotation_pb2 import CircleAnnotation
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set

from common.config import Config
from common.geometry import Pose2
from common.messages import DockingState
from common.recording.mcap_file import Schema
from common.timing import NS_PER_S

TRANSFORMS, SCENE, ANNOTATIONS = "foxglove/transforms", "foxglove/scene", "foxglove/camera/annotations"
IMAGE, CALIBRATION, FRAMES = "foxglove/camera/image", "foxglove/camera/calibration", "foxglove/camera/frames"
_KINDS: dict[str, Any] = {
    TRANSFORMS: FrameTransforms,
    SCENE: SceneUpdate,
    ANNOTATIONS: ImageAnnotations,
    IMAGE: CompressedImage,
    FRAMES: CompressedImage,
    CALIBRATION: CameraCalibration,
}
_DISTORTION = {"rational": "rational_polynomial", "fisheye": "kannala_brandt"}
_LED_M, _ROBOT_M, _TROLLEY_M = 0.03, (0.7, 0.5, 0.4), (0.9, 0.5, 0.9)
_MEASURED, _PREDICTED = (1.0, 0.75, 0.2, 1.0), (0.2, 0.9, 1.0, 1.0)
_FOLLOWER, _TROLLEY = (0.2, 0.5, 0.9, 0.6), (0.6, 0.6, 0.65, 0.5)


def schema(topic: str) -> Schema:
    """The schema of one of these topics."""
    kind = _KINDS[topic]
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", build_file_descriptor_set(kind).SerializeToString())


def read_image(data: bytes) -> tuple[int, bytes]:
    """Capture time [ns] and the JPEG or PNG bytes of a recorded image."""
    image = CompressedImage()
    image.ParseFromString(data)
    return image.timestamp.seconds * NS_PER_S + image.timestamp.nanos, image.data


def image(capture_ns: int, data: bytes, form: str) -> bytes:
    """An image, compressed as ``form``."""
    return _packed(CompressedImage(timestamp=_stamp(capture_ns), frame_id="camera", data=data, format=form))


class Drawing:
    """Draws states of one configuration."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._leds = config.leds.points

    def calibration(self, time_ns: int) -> bytes:
        """The camera with its lens."""
        camera, lens = self._config.camera, self._config.camera.lens
        matrix = [lens.fx_px, 0.0, lens.cx_px, 0.0, lens.fy_px, lens.cy_px, 0.0, 0.0, 1.0]
        return _packed(
            CameraCalibration(
                timestamp=_stamp(time_ns),
                frame_id="camera",
                width=camera.width_px,
                height=camera.height_px,
                K=matrix,
                P=[*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
                R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                distortion_model=_DISTORTION.get(lens.model, ""),
                D=list(lens.coefficients),
            )
        )

    def transforms(self, state: DockingState) -> bytes:
        """The estimated pose of {F} in {L}, and the camera on it."""
        pose = Pose2(state.x_m, state.y_m, state.theta_rad).inverse()
        mount = self._config.camera.mount
        follower = FrameTransform(parent_frame_id="leader", child_frame_id="follower")
        _place(follower.translation, (pose.x_m, pose.y_m, 0.0))
        _turn(follower.rotation, pose.theta_rad)
        camera = FrameTransform(parent_frame_id="follower", child_frame_id="camera")
        _place(camera.translation, tuple(map(float, mount)))
        # {C} looks along x of {F}: its z forward, its x right, its y down
        camera.rotation.x, camera.rotation.y, camera.rotation.z, camera.rotation.w = -0.5, 0.5, -0.5, 0.5
        for transform in (follower, camera):
            transform.timestamp.CopyFrom(_stamp(state.capture_ns))
        return _packed(FrameTransforms(transforms=[follower, camera]))

    def scene(self, state: DockingState) -> bytes:
        """LEDs of {L} and the Follower, which moves with its frame: once is enough."""
        leds = SceneEntity(timestamp=_stamp(state.capture_ns), frame_id="leader", id="leds")
        for point in self._leds:
            sphere = SpherePrimitive(color=_color(_MEASURED))
            _place(sphere.pose.position, tuple(map(float, point)))
            sphere.pose.orientation.w = 1.0
            _place(sphere.size, (_LED_M, _LED_M, _LED_M))
            leds.spheres.append(sphere)
        robot = _box("follower", "follower", state.capture_ns, (0.0, 0.0, 0.0), _ROBOT_M, _FOLLOWER)
        return _packed(SceneUpdate(entities=[leds, robot]))

    def trolleys(self, time_ns: int, handles: list[tuple[float, float, float]]) -> bytes:
        """Trolleys of a simulated world by the handles' poses in {L}."""
        entities = [
            _box(f"trolley {number}", "leader", time_ns, (x_m + _TROLLEY_M[0] / 2, y_m, theta), _TROLLEY_M, _TROLLEY)
            for number, (x_m, y_m, theta) in enumerate(handles, start=1)
        ]
        return _packed(SceneUpdate(entities=entities))

    def annotations(self, state: DockingState) -> bytes:
        """Measured features as circles, predicted ones as smaller circles, by undistorted pixel."""
        pinhole = self._config.camera.pinhole
        drawn = ImageAnnotations()
        measured = [feature for feature in state.features if feature is not None]
        for features, size, colour in ((measured, 14.0, _MEASURED), (state.features_filtered, 8.0, _PREDICTED)):
            if not features:
                continue
            for u, v in pinhole.to_pixels(np.array(features)):
                drawn.circles.append(
                    CircleAnnotation(
                        timestamp=_stamp(state.capture_ns),
                        position=Point2(x=float(u), y=float(v)),
                        diameter=size,
                        thickness=2.0,
                        outline_color=_color(colour),
                    )
                )
        return _packed(drawn)


def _box(
    name: str,
    frame: str,
    time_ns: int,
    pose: tuple[float, float, float],
    size_m: tuple[float, float, float],
    colour: tuple[float, float, float, float],
) -> SceneEntity:
    cube = CubePrimitive(color=_color(colour))
    _place(cube.pose.position, (pose[0], pose[1], size_m[2] / 2))
    _turn(cube.pose.orientation, pose[2])
    _place(cube.size, size_m)
    return SceneEntity(timestamp=_stamp(time_ns), frame_id=frame, id=name, cubes=[cube])


def _packed(message: Message) -> bytes:
    packed: bytes = message.SerializeToString(deterministic=True)
    return packed


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(seconds=time_ns // NS_PER_S, nanos=time_ns % NS_PER_S)


def _place(vector: Any, xyz: tuple[float, ...]) -> None:
    vector.x, vector.y, vector.z = xyz


def _turn(quaternion: Any, yaw_rad: float) -> None:
    quaternion.z, quaternion.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)


def _color(rgba: tuple[float, float, float, float]) -> Color:
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])
