"""The results of predictors.py as Markdown tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

SETS = {"taf_bw": "TAF-BW", "commonroad": "MONA"}


def tables(numbers: Mapping[str, Any]) -> str:
    """All tables that the results allow."""
    return "\n\n".join(
        part
        for part in (
            _errors(numbers, "all", "Errors after 3 s, all vehicles of the test part"),
            _errors(numbers, "moving", "Errors after 3 s, vehicles that move at the moment"),
            _left_out(numbers),
            _loops(numbers),
        )
        if part
    )


def _runs(numbers: Mapping[str, Any], part: str) -> dict[str, list[Any]]:
    """Results by driver; those that differ in the training's seed alone together."""
    found: dict[str, list[Any]] = {}
    for key, value in numbers.items():
        kind, _, name = key.partition("|")
        if kind == part:
            base = re.sub(r"-\d+(?=$|\+)", "", name)
            found.setdefault(base, []).append(value)
    return found


def _mean(sums: Mapping[str, Any], dataset: str, group: str) -> list[float]:
    """ADE, FDE, best of six and number of vehicles of a dataset."""
    rows = [
        np.array(v, dtype=float)
        for k, v in sums.items()
        if k.startswith(f"{dataset}|") and k.endswith(f"|{group}")
    ]
    if not rows:
        return [float("nan")] * 4
    total = np.sum(rows, axis=0)
    return [*(total[1:] / max(total[0], 1)), total[0]]


def _errors(numbers: Mapping[str, Any], group: str, title: str) -> str:
    lines = [f"**{title}** (m; ADE / FDE, best of six FDE; mean over seeds)", ""]
    lines += ["| driver | seeds | " + " | ".join(SETS.values()) + " |", "|---|---|---|---|"]
    for name, runs in _runs(numbers, "errors").items():
        if "without" in name:
            continue
        cells = []
        for dataset in SETS:
            each = np.array([_mean(run, dataset, group) for run in runs])
            ade, fde, best, _ = each.mean(0)
            spread = f" (±{each[:, 1].std():.2f})" if len(runs) > 1 else ""
            six = "" if np.isnan(best) else f", {best:.2f}"
            cells.append(f"{ade:.2f} / {fde:.2f}{spread}{six}")
        lines.append(f"| {name} | {len(runs)} | " + " | ".join(cells) + " |")
    return "\n".join(lines) if len(lines) > 4 else ""


def _left_out(numbers: Mapping[str, Any]) -> str:
    lines = [
        "**Leave one site out** (m; ADE / FDE, best of six FDE on the site left out; mean over seeds)",
        "",
    ]
    lines += ["| site | all vehicles | moving |", "|---|---|---|"]
    pooled: dict[tuple[str, str], list[Any]] = {}
    for name, runs in _runs(numbers, "errors").items():
        if "without" not in name:
            continue
        cells = []
        for group in ("all", "moving"):
            each = []
            for run in runs:
                for dataset in SETS:
                    found = _mean(run, dataset, group)
                    if found[3] > 0:
                        each.append(found)
                        pooled.setdefault((dataset, group), []).append(found)
            ade, fde, best, count = np.array(each).mean(0)
            cells.append(f"{ade:.2f} / {fde:.2f}, {best:.2f} ({count:.0f})")
        lines.append(f"| {name.partition('without-')[2]} | " + " | ".join(cells) + " |")
    for dataset, label in SETS.items():
        cells = []
        for group in ("all", "moving"):
            rows = np.array(pooled.get((dataset, group), [[np.nan] * 4]))
            mean = (rows[:, :3] * rows[:, 3:]).sum(0) / rows[:, 3].sum()
            cells.append(f"{mean[0]:.2f} / {mean[1]:.2f}, {mean[2]:.2f}")
        lines.append(f"| all of {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines) if pooled else ""


def _loops(numbers: Mapping[str, Any]) -> str:
    lines = [
        "**10 s of closed loop, perturbed starts** (% of vehicles: leave the road / collide / |a| > 6 m/s²)",
        "",
    ]
    lines += ["| driver | seeds | " + " | ".join(SETS.values()) + " |", "|---|---|---|---|"]
    for name, runs in _runs(numbers, "loop").items():
        cells = []
        for dataset in SETS:
            each = []
            for run in runs:
                total = np.sum([v for k, v in run.items() if k.startswith(f"{dataset}|")], axis=0)
                each.append(100 * total[1:] / max(total[0], 1))
            left, hit, hard = np.mean(each, axis=0)
            cells.append(f"{left:.1f} / {hit:.1f} / {hard:.1f}")
        lines.append(f"| {name} | {len(runs)} | " + " | ".join(cells) + " |")
    return "\n".join(lines) if len(lines) > 4 else ""
