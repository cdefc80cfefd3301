"""The record of each docking on the robot: what came before it, all of it, and how it ended."""
