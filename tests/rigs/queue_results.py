"""Dockings as the experiments of the collection record them."""

from __future__ import annotations

from experiments.queues.run import Docking


def docked(trolley: int, e_y_cm: float) -> Docking:
    metrics = {"e_x_cm": 0.5, "e_y_cm": e_y_cm, "e_theta_deg": 0.2, "e_p_px": 1.0}
    return Docking(trolley, "done", "", metrics=metrics, locked=True)
