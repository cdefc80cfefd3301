"""The light: LEDs, lamps, reflections and the sensor that turns them into frames."""
