"""Camera process: light → frame, through shared memory."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from pydantic import ValidationError

from common.channels import DOCKING_STATE, FRAME
from common.errors import DeviceError
from common.frames.ring import FrameRing
from common.frames.source import Capture, FrameSource, frame_source
from common.messages import Frame
from common.node import Inbox, Node, NodeContext, Output
from common.timing import NS_PER_S
from follower.camera.exposure import ExposureRetry

_REOPEN_NS = NS_PER_S
_log = logging.getLogger("follower-camera")


class CameraNode(Node):
    """Numbers the frames, puts their pixels into the ring and publishes a note of each.

    Where the estimator finds the images badly exposed, one other exposure is tried.
    """

    name = "follower-camera"
    outputs = (FRAME,)

    def __init__(self, context: NodeContext, source: FrameSource) -> None:
        self._camera = context.config.camera
        self._runtime = context.runtime
        self._source = source
        self._sequence = 0
        self._reopen_ns: int | None = None
        self.trigger = source.trigger
        self.inputs = (*source.inputs, DOCKING_STATE)
        self._retry = ExposureRetry(self._camera.exposure_us, self._camera.rate_hz)

    def start(self, now_ns: int) -> None:  # noqa: ARG002 - the contract's signature
        """Make the ring and open the camera."""
        self._ring = FrameRing(self._runtime, self._camera.width_px, self._camera.height_px)
        self._source.open()

    def step(self, now_ns: int, inputs: Inbox) -> Sequence[Output]:
        """Publish the next frame if there is one; after a lost camera try to open it once a second."""
        if self._reopen_ns is not None:
            if now_ns < self._reopen_ns:
                return ()
            self._reopen_ns = None if self._reopened() else now_ns + _REOPEN_NS
            return ()
        sequence = self._sequence + 1
        self._set_exposure(now_ns, inputs)
        try:
            capture = self._source.grab(now_ns, inputs, self._ring.slot(sequence))
            if capture is None:
                return ()
            frame = self._note(sequence, capture)
        except DeviceError as error:
            _log.error("%s", error)
            self._source.close()
            self._reopen_ns = now_ns + _REOPEN_NS
            return ()
        self._sequence = sequence
        return ((FRAME, frame),)

    def stop(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Close the camera."""
        self._source.close()
        return ()

    def _set_exposure(self, now_ns: int, inputs: Inbox) -> None:
        """Another exposure if the newest state asks for it."""
        state, before_us = inputs.arrived(DOCKING_STATE), self._retry.exposure_us
        if state is None:
            return
        exposure_us = self._retry.judge(now_ns, state.cause)
        if exposure_us != before_us:
            _log.warning("images are %s: exposure %g µs after %g µs", state.cause, exposure_us, before_us)
            self._source.expose(exposure_us)

    def _note(self, sequence: int, capture: Capture) -> Frame:
        """Commit the slot and describe what lies in it.

        Raises:
            DeviceError: the source reports values that no camera has.
        """
        try:
            return Frame(
                sequence=sequence,
                slot=self._ring.commit(sequence),
                capture_ns=capture.capture_ns,
                camera_id=capture.camera_id,
                width_px=self._camera.width_px,
                height_px=self._camera.height_px,
                exposure_us=capture.exposure_us,
                gain=capture.gain,
            )
        except ValidationError as error:
            fault = error.errors()[0]
            key = ".".join(str(part) for part in fault["loc"])
            raise DeviceError(f"{capture.camera_id}: {key} = {fault['input']!r}: {fault['msg']}") from error

    def _reopened(self) -> bool:
        try:
            self._source.open()
        except DeviceError as error:
            _log.warning("%s", error)
            return False
        self._retry = ExposureRetry(self._camera.exposure_us, self._camera.rate_hz)
        return True


def make(context: NodeContext) -> CameraNode:
    """The camera process with the configured driver."""
    return CameraNode(context, frame_source(context))
