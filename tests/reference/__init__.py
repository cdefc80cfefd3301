"""Recordings that the robots' decisions are held against; ``python -m tests.reference.update`` makes them again."""
