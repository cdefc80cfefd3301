"""CAN nodes, axes, wiring and the network: what an engineer brings up before the first docking."""
