"""Both simulated CAN buses: CiA 402 drives, CiA 401 modules, their faults, and the server in place of the wire."""
