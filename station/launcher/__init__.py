"""Runs dockings of both robots, one or a queue, against the simulated backend: as processes, or stepped in this one.

The only place outside experiments and tests that knows the simulated backend by name.
"""
