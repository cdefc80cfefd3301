"""The phases of a docking, a class each; which follows which is in ``transitions.py``."""
