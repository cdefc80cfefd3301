"""The histogram of a latency trace."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt


def draw(hops_ms: dict[str, list[float]], path: Path) -> Path:
    """One histogram a hop, on one time axis.

    Args:
        hops_ms: durations by hop [ms].
        path: of the picture.
    """
    shown = {name: values for name, values in hops_ms.items() if values}
    most = max((max(values) for values in shown.values()), default=1.0)
    bins = np.linspace(0.0, 1.02 * most, 80)
    figure, axes = plt.subplots(
        max(1, len(shown)),
        1,
        figsize=(8, 1.5 * max(1, len(shown)) + 0.5),
        sharex=True,
        squeeze=False,
        layout="constrained",
    )
    for axis, (name, values) in zip(axes[:, 0], shown.items(), strict=False):
        axis.hist(values, bins=bins, color="tab:blue")
        axis.axvline(float(np.percentile(values, 99)), color="tab:red", lw=1, ls="--", label="p99")
        axis.set_ylabel("images")
        axis.set_title(name, fontsize=9, loc="left")
        axis.set_yscale("log")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    axes[-1, 0].set_xlabel("ms")
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
