"""``davpc export`` and ``davpc trace``: a recording as tables, and its way from image to CAN."""
