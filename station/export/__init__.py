"""``davpc record``, ``export`` and ``trace``: into a file, out of it as tables, and the way from image to CAN."""
