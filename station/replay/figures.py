"""The picture of a replay with another setting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

from station.replay.what_if import FieldTrace

mpl.use("Agg")

from matplotlib import pyplot as plt


def draw(traces: Sequence[FieldTrace], label: str, path: Path) -> Path:
    """Each field over time, recorded and other.

    Args:
        traces: of the fields.
        label: of the other setting.
        path: of the picture.
    """
    figure, axes = plt.subplots(
        len(traces), 1, figsize=(9, 1.9 * len(traces) + 0.6), sharex=True, squeeze=False, layout="constrained"
    )
    start_s = min(trace.time_s[0] for trace in traces if trace.time_s)
    for axis, trace in zip(axes[:, 0], traces, strict=True):
        time_s = [at - start_s for at in trace.time_s]
        axis.plot(time_s, trace.recorded, lw=1.4, color="tab:blue", label="recorded")
        axis.plot(time_s, trace.other, lw=1.0, color="tab:orange", label=label)
        axis.set_ylabel(f"{trace.core}\n{trace.name}", fontsize=8)
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8, ncols=2)
    axes[-1, 0].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
