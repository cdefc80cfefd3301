"""What it costs: the controller, perception and the CAN bus, each beside a reference in the same run."""
