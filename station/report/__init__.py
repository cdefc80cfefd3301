"""``davpc report``: what happened in a recorded docking, why it ended, and what to do."""
