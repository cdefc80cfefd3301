"""Self-calibration: camera, LEDs, wheels and latency from recorded approaches."""
