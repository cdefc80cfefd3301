"""python-can interface ``stepped``: a simulated bus in the same process, in the time of a simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar

import can

from common.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, CanFrame
from sim.can.bus import SimulatedBus


class SteppedChannel:
    """A simulated bus under a channel name, for as long as the ``with`` block lasts.

    Every client receives the frames of the nodes and of the other clients, at once. ``tick`` runs what the nodes do
    by themselves.
    """

    _open: ClassVar[dict[str, SteppedChannel]] = {}

    def __init__(self, name: str, bus: SimulatedBus, now_ns: Callable[[], int]) -> None:
        self.name = name
        self._bus = bus
        self._now_ns = now_ns
        self._clients: list[SteppedBus] = []

    def __enter__(self) -> SteppedChannel:
        if self.name in self._open:
            raise ValueError(f"stepped channel {self.name!r} is open already")
        self._open[self.name] = self
        return self

    def __exit__(self, *_: object) -> None:
        del self._open[self.name]
        for client in self._clients:
            client.unplug()

    @classmethod
    def find(cls, name: str) -> SteppedChannel:
        """The open channel of this name.

        Raises:
            can.CanInitializationError: there is none.
        """
        try:
            return cls._open[name]
        except KeyError:
            raise can.CanInitializationError(f"no simulation has opened channel {name!r}") from None

    def tick(self) -> None:
        """Deliver what the nodes send by themselves now."""
        self._deliver(self._bus.tick(self._now_ns()), None)

    def join(self, client: SteppedBus) -> None:
        """Connect a client."""
        self._clients.append(client)

    def leave(self, client: SteppedBus) -> None:
        """Disconnect a client."""
        self._clients.remove(client)

    def transmit(self, frame: CanFrame, sender: SteppedBus) -> None:
        """Deliver a client's frame to the other clients and to the nodes, whose answers go to every client."""
        if len(self._clients) > 1:
            self._deliver([frame], sender)
        self._deliver(self._bus.handle(frame, self._now_ns()), None)

    def _deliver(self, frames: list[CanFrame], sender: SteppedBus | None) -> None:
        if not frames:
            return
        for client in self._clients:
            if client is not sender:
                client.inbox.extend(frames)


class SteppedBus(can.BusABC):
    """The client's end; receiving never blocks, since no time passes during a wait."""

    def __init__(self, channel: str, **_: Any) -> None:
        self.inbox: deque[CanFrame] = deque(maxlen=65536)
        self.channel_info = f"stepped channel {channel}"
        self._link: SteppedChannel | None = SteppedChannel.find(channel)
        self._link.join(self)
        super().__init__(channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; the answers of the nodes have arrived when this returns."""
        del timeout
        if self._link is None:
            raise can.CanOperationError("the simulation has ended")
        self._link.transmit(CanFrame(msg.arbitration_id, bytes(msg.data)), self)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        del timeout
        if not self.inbox:
            if self._link is None:
                raise can.CanOperationError("the simulation has ended")
            return None, True
        frame = self.inbox.popleft()
        if frame.can_id & ERROR_FLAG:
            return can.Message(arbitration_id=frame.can_id & ~ERROR_FLAG, data=frame.data, is_error_frame=True), True
        return can.Message(
            arbitration_id=frame.can_id & ~(EXTENDED_FLAG | REMOTE_FLAG),
            data=frame.data,
            is_extended_id=bool(frame.can_id & EXTENDED_FLAG),
            is_remote_frame=bool(frame.can_id & REMOTE_FLAG),
        ), True

    def unplug(self) -> None:
        """The simulation has ended: sending and receiving fail from now on."""
        self._link = None

    def shutdown(self) -> None:
        """Disconnect."""
        super().shutdown()
        if self._link is not None:
            self._link.leave(self)
            self._link = None
