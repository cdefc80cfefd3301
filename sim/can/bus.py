"""A simulated CAN bus: hands frames to nodes and collects what they send. No sockets, no threads, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from common.canopen.frames import HEARTBEAT, NMT, SYNC, CanFrame
from sim.can.faults import BusFaults


class BusNode(Protocol):
    """A node on the bus."""

    node_id: int

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """React to a frame of the master; the frames that the node sends in return."""

    def tick(self, now_ns: int) -> list[CanFrame]:
        """What the node sends by itself at this time."""

    def excuse_stall(self, stall_ns: int) -> None:
        """Do not count a stall of the simulation as silence of the master."""


class SimulatedBus:
    """Nodes on one bus, with the faults that ``faults`` injects.

    Not modelled: arbitration, delay, frames from one simulated node to another.
    """

    def __init__(self, nodes: Sequence[BusNode]) -> None:
        self.nodes = tuple(nodes)
        self.faults = BusFaults()
        self._by_id = {node.node_id: node for node in nodes}
        if len(self._by_id) != len(self.nodes):
            raise ValueError("two nodes have the same id")

    def handle(self, frame: CanFrame, now_ns: int) -> list[CanFrame]:
        """Deliver a frame of the master; the nodes' answers, ordered by node."""
        can_id, faulty = frame.can_id, self.faults.active
        if can_id in (NMT, SYNC) or can_id & 0x780 == HEARTBEAT:
            sent: list[CanFrame] = []
            for node in self.nodes:
                if not faulty or self.faults.reaches(node.node_id):
                    sent += node.handle(frame, now_ns)
        else:
            addressed = self._by_id.get(can_id & 0x7F)
            if addressed is None or (faulty and not self.faults.reaches(addressed.node_id)):
                sent = []
            else:
                sent = addressed.handle(frame, now_ns)
        return self.faults.spoil(sent) if faulty else sent

    def tick(self, now_ns: int) -> list[CanFrame]:
        """What the nodes send by themselves at this time."""
        sent = [frame for node in self.nodes for frame in node.tick(now_ns)]
        return self.faults.spoil(sent) if self.faults.active else sent

    def excuse_stall(self, stall_ns: int) -> None:
        """The simulation itself stalled: pass it on to every node."""
        for node in self.nodes:
            node.excuse_stall(stall_ns)
