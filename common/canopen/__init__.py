"""CANopen as both robots use it: frames, the bus, bringing up nodes, and the states of CiA 402 drives."""
