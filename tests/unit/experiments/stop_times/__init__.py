"""Tests of experiments/stop_times."""
