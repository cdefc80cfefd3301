"""A simulated CAN bus: hands frames to nodes and collects what they send. No sockets, no threads, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from common.canopen_frames import HEARTBEAT, NMT, SYNC, CanFrame


class BusNode(Protocol):
    """What is connected to the bus."""

    node_id: int

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """React to a frame of somebody else."""

    def tick(self, now_ns: int) -> list[CanFrame]:
        """Do what is due at this time."""


class SimulatedBus:
    """Nodes on one bus, without arbitration, delay or loss. Simulated nodes do not hear one another."""

    def __init__(self, nodes: Sequence[BusNode]) -> None:
        self.nodes = tuple(nodes)
        self._by_id = {node.node_id: node for node in nodes}
        if len(self._by_id) != len(self.nodes):
            raise ValueError("two nodes have the same id")

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """A frame from outside; the nodes' answers in the order of arbitration by node."""
        service = frame.can_id & 0x780
        if frame.can_id in (NMT, SYNC) or service == HEARTBEAT:
            answers: list[CanFrame] = []
            for node in self.nodes:
                answers += node.handle(frame, now_ns)
            return answers
        addressed = self._by_id.get(frame.can_id & 0x7F)
        return addressed.handle(frame, now_ns) if addressed is not None else []

    def tick(self, now_ns: int) -> list[CanFrame]:
        """What the nodes send by themselves at this time."""
        sent: list[CanFrame] = []
        for node in self.nodes:
            sent += node.tick(now_ns)
        return sent
