"""results.json and its Markdown table, the same for every experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from common.config import Config
from common.files.writer import write_json

HEADINGS = {
    "e_x_cm": "e_x cm",
    "e_y_cm": "e_y cm",
    "e_theta_deg": "e_θ °",
    "e_p_px": "e_p px",
    "m_v": "M_v",
    "m_w": "M_ω",
    "lost": "lost",
    "over_bound": "> 6 cm",
    "settle_s": "settled s",
    "worst_e_y_cm": "worst e_y cm",
}


def row(method: str, case: str, n: int, metrics: Mapping[str, float | None]) -> dict[str, Any]:
    """One row of results.json.

    Args:
        method: the controller or fault under test.
        case: what it ran on.
        n: number of runs.
        metrics: by name; None: not measured.
    """
    return {"method": method, "case": case, "n": n, "metrics": dict(metrics)}


def configuration(config: Config) -> dict[str, Any]:
    """The configuration that an experiment was given, overrides and all, for its ``settings``."""
    return {"configuration": config.model_dump(mode="json")}


def write_results(
    out: Path,
    experiment: str,
    seed: int,
    settings: dict[str, Any],
    rows: list[dict[str, Any]],
    paper: list[Any],
    config: Config,
    note: str = "",
) -> dict[str, Any]:
    """Write ``results.json`` and ``table.md``.

    Args:
        out: folder to write to; made if missing.
        experiment: its name.
        seed: random seed.
        settings: what was varied and how often.
        rows: of :func:`row`.
        paper: the paper's values for comparison.
        config: added to the settings, so that a result records the configuration it was measured with.
        note: text below the table.

    Returns:
        The content of ``results.json``.
    """
    settings = settings | configuration(config)
    out.mkdir(parents=True, exist_ok=True)
    content = {"experiment": experiment, "seed": seed, "settings": settings, "rows": rows, "paper": paper}
    results = write_json(out / "results.json", content)
    text = markdown(experiment, results["rows"]) + (f"\n{note}\n" if note else "")
    (out / "table.md").write_text(text, encoding="utf-8")
    return results


def missed_note(missed: Sequence[str]) -> str:
    """Note below a table whose runs must all be right: how many are not, each on a line."""
    return "\n".join([f"{len(missed)} missed:", *(f"- {line}" for line in missed)]) if missed else "None missed."


def markdown(experiment: str, rows: list[dict[str, Any]]) -> str:
    """Rows as a Markdown table, with the columns that any of them has."""
    known = [name for name in HEADINGS if any(name in entry["metrics"] for entry in rows)]
    others = sorted({name for entry in rows for name in entry["metrics"]} - set(HEADINGS))
    columns: list[str] = [*known, *others]
    lines = [
        f"# {experiment}",
        "",
        "| method | case | n | " + " | ".join(HEADINGS.get(name, name) for name in columns) + " |",
        "|---|---|---|" + "---|" * len(columns),
    ]
    for entry in rows:
        cells = [_cell(entry["metrics"].get(name)) for name in columns]
        lines.append(" | ".join(["", str(entry["method"]), str(entry["case"]), str(entry["n"]), *cells, ""]).strip())
    return "\n".join(lines) + "\n"


def _cell(value: float | None) -> str:
    if value is None:
        return "–"
    if float(value).is_integer() and abs(value) < 1e6:
        return str(int(value))
    return f"{value:.3g}" if abs(value) < 0.1 else f"{value:.3f}"
