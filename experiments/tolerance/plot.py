"""Figure of the tolerance experiment: lateral error at the dock, a point a robot, by class of error and method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.tolerance.docking import ApproachEnd

_COLOURS = ("#0072b2", "#e69f00", "#009e73")
_LEAST_CM = 1e-3


def draw_tolerance(groups: Sequence[tuple[str, str, Sequence[ApproachEnd]]], path: Path) -> None:
    """Draw it; robots that did not arrive are crosses at the right edge.

    Args:
        groups: method, case, and how its dockings ended.
        path: file to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cases = list(dict.fromkeys(case for _, case, _ in groups))
    methods = list(dict.fromkeys(method for method, _, _ in groups))
    figure = Figure(figsize=(9, 1.2 + 0.55 * len(cases)), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    for method, case, ends in groups:
        at = cases.index(case) + 0.22 * (methods.index(method) - (len(methods) - 1) / 2)
        colour = _COLOURS[methods.index(method) % len(_COLOURS)]
        errors = [max(100 * abs(end.error.e_y_m), _LEAST_CM) for end in ends if not end.cause]
        axis.plot(errors, np.full(len(errors), at), ".", ms=4, alpha=0.5, color=colour)
        if errors:
            axis.plot(np.mean(errors), at, "|", ms=12, mew=2, color=colour)
        lost = sum(bool(end.cause) for end in ends)
        if lost:
            axis.plot(20.0, at, "x", color=colour)
            axis.annotate(f" {lost}", (20.0, at), fontsize=7, va="center", color=colour)
    for method, colour in zip(methods, _COLOURS, strict=False):
        axis.plot([], [], "o", color=colour, label=method)
    axis.set(xscale="log", xlim=(_LEAST_CM, 40.0), xlabel="|e_y| at the dock [cm]; bar: mean; cross: not arrived")
    axis.set_yticks(range(len(cases)), [case.replace("_", " ") for case in cases])
    axis.invert_yaxis()
    axis.grid(alpha=0.3)
    axis.legend(loc="upper left", fontsize=8)
    figure.savefig(path)
