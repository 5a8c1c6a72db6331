"""The results of predictors.py as Markdown tables."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

# What a site's name begins with, and the place that it is counted with.
PLACES = {
    "k7": "TAF-BW",
    "C-DEU_MONA": "MONA",
    "USA_Lanker": "Lankershim",
    "USA_Peach": "Peachtree",
    "DR_": "INTERACTION",
}
NAMES = tuple(PLACES.values())
YARDSTICK = {"moving": "straight_on", "standing": "stands_still"}
WORDS = {
    "moving": "Vehicles that are moving at the moment",
    "standing": "Vehicles that are standing at the moment",
}


def place(site: str) -> str:
    """The place that a site is counted with."""
    return next((name for begin, name in PLACES.items() if site.startswith(begin)), site)


def tables(numbers: Mapping[str, Any]) -> str:
    """All tables that the results allow."""
    joint = [sums for name, sums in numbers.items() if name.startswith("joint|")]
    sites = sorted({key.split("|")[1] for sums in joint for key in sums})
    places = {key.split("|")[1] for name in YARDSTICK.values() for key in numbers.get(f"errors|{name}", {})}
    parts = (
        *(_errors(numbers, group, NAMES) for group in WORDS),
        _errors(numbers, "moving", sorted(site for site in places if place(site) == "INTERACTION")),
        _joint(numbers, NAMES),
        _joint(numbers, sites),
    )
    return "\n\n".join(part for part in parts if part)


def _runs(numbers: Mapping[str, Any], part: str) -> dict[str, list[Any]]:
    """Results by driver; those that differ in the training's seed alone together."""
    found: dict[str, list[Any]] = {}
    for key, value in numbers.items():
        kind, _, name = key.partition("|")
        if kind == part:
            base = re.sub(r"-\d+(?=$|\+)", "", name)
            found.setdefault(base, []).append(value)
    return found


def _mean(sums: Mapping[str, Any], begin: str, group: str) -> list[float]:
    """ADE, FDE, best of six and number of vehicles of a place or a site."""
    rows = [
        np.array(v, dtype=float)
        for k, v in sums.items()
        if k.endswith(f"|{group}") and begin in k.split("|")[:2]
    ]
    total = np.sum(rows, axis=0) if rows else np.zeros(4)
    return [*(total[1:] / total[0] if total[0] else np.full(3, np.nan)), total[0]]


def _cell(runs: Sequence[Any], yardstick: Any, begin: str, group: str) -> str:
    """FDE of some runs, their spread, their share of the yardstick's, and that of the best of six."""
    each = np.array([_mean(run, begin, group) for run in runs])
    _, fde, best, count = each.mean(0)
    if not count:
        return ""
    against = _mean(yardstick, begin, group)[1]
    spread = f" ±{each[:, 1].std():.2f}" if len(runs) > 1 else ""
    six = "" if np.isnan(best) else f", six {best / against:.2f}"
    return f"{fde:.2f}{spread} ({fde / against:.2f}{six})"


def _errors(numbers: Mapping[str, Any], group: str, names: Sequence[str]) -> str:
    runs = _runs(numbers, "errors")
    if YARDSTICK[group] not in runs or not names:
        return ""
    (yardstick,) = runs[YARDSTICK[group]]
    counts = [f"{name} ({_mean(yardstick, name, group)[3]:.0f})" for name in names]
    lines = [
        f"**{WORDS[group]}: error after 3 s** (m, mean over trainings; in brackets "
        f"its share of `{YARDSTICK[group]}`, and that of the best of six)",
        "",
        "| driver | trainings | " + " | ".join(counts) + " |",
        "|---|---|" + "---|" * len(names),
    ]
    for name, found in runs.items():
        cells = [_cell(found, yardstick, begin, group) for begin in names]
        lines.append(f"| {name} | {len(found)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _joint(numbers: Mapping[str, Any], names: Sequence[str]) -> str:
    lines = [
        "**Six futures of a scene: minJointFDE (ADE) m, minJointMR / consistent, collisions** "
        "(% of futures; in recordings; error of moving vehicles in a future, as a share of `straight_on`)",
        "",
        "| driver | trainings | " + " | ".join(names) + " |",
        "|---|---|" + "---|" * len(names),
    ]
    for name, runs in _runs(numbers, "joint").items():
        cells = []
        for begin in names:
            found = [[np.array(v) for k, v in run.items() if begin in k.split("|")] for run in runs]
            if not any(found):
                cells.append("")
                continue
            totals = np.array([np.sum(rows, axis=0) for rows in found if rows])
            ade, fde, mr, consistent, hit, recorded = np.mean(totals[:, 1:7] / totals[:, :1], axis=0)
            share = np.mean(totals[:, 8] / totals[:, 9])
            cells.append(
                f"{fde:.2f} ({ade:.2f}), {mr:.2f} / {consistent:.2f}, "
                f"{100 * hit:.0f} ({100 * recorded:.0f}); {share:.2f}"
            )
        lines.append(f"| {name} | {len(runs)} | " + " | ".join(cells) + " |")
    return "\n".join(lines) if len(lines) > 4 else ""
