"""The phases of a docking, one class each; their order is in ``transitions.py``."""
