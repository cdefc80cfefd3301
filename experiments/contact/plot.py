"""Figure of the contact experiment: force at the handle over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.config import ArmsConfig
from common.geometry import Array

Columns = dict[str, Array]


def draw_contact(push: Columns, approach: Columns, arms: ArmsConfig, path: Path) -> None:
    """Draw one push with contact and connection marked, and one approach over pads, with the thresholds.

    Args:
        push: samples of the push as columns of equal length.
        approach: samples of the approach, alike.
        arms: thresholds.
        path: file to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1)
    for axis, run, title in ((upper, push, "push into the guide"), (lower, approach, "approach over rubber pads")):
        axis.plot(run["time_s"], run["true_n"], color="0.65", lw=1, label="true force on the handle")
        axis.plot(run["time_s"], run["felt_n"], color="#0072b2", label="from the six joint torques")
        axis.plot(run["time_s"], run["resistance_n"], ":", color="#009e73", label="learned resistance")
        axis.plot(
            run["time_s"],
            run["resistance_n"] + arms.contact_force_n,
            "--",
            color="#e69f00",
            label="contact threshold",
        )
        axis.axhline(arms.connected_force_n, ls="--", color="#d55e00", label="connection threshold")
        for name, colour in (("contact", "#e69f00"), ("connected", "#d55e00")):
            if run[name].any():
                time_s = run["time_s"][int(np.argmax(run[name]))]
                axis.axvline(time_s, color=colour, lw=2, label=f"{name} at {time_s:.2f} s")
        axis.set(xlabel="t [s]", ylabel="force [N]", title=title)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, loc="upper left")
    figure.savefig(path)
