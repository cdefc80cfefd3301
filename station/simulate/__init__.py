"""``davpc sim``: dockings of both robots, one or a queue, as processes or stepped in this one.

The only place outside experiments and tests that names the simulated backend.
"""
