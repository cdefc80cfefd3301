"""Frames between processes: the ring of shared memory they cross by, and what a camera driver has to offer."""
