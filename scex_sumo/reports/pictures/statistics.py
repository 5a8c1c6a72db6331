"""Pictures of what the numbers of runs and the assignments do to the densities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.reports.pictures import sheet
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import density, dkw_half_width
from scex_sumo.studies.explain import Explanation

_WIDE = 4  # panels side by side
_SUBSETS = ("#1f4e79", "#2e8b57", "#d98c21", "#c0392b", "#7d3c98")
_DESIGNS = ("#1f4e79", "#c0392b", "#2e8b57", "#d98c21", "#7d3c98", "#555555")


def draw_subsets(run: Run, subsets: Mapping[int, IntArray], stem: Path) -> list[Path]:
    """Density of every metric that is defined, over all children and one subset of each size, SVG and PNG.

    Args:
        subsets: children of one subset by size.
        stem: path without ending.
    """
    columns = [column for column in run.columns if np.isfinite(run.samples(column)).any()]
    with sheet.sheet(11.5, 1.0 + 1.5 * -(-len(columns) // _WIDE)) as figure:
        for axes, column in sheet.metric_panels(figure, columns, wide=_WIDE):
            values = run.values(column)
            known = values[np.isfinite(values)]
            folded = bool(known.min() >= 0)
            curve = density(known, reflect=folded)
            axes.fill_between(curve.x, curve.pdf, color="#bbbbbb", linewidth=0)
            for children, color in zip(subsets.values(), _SUBSETS, strict=False):
                some = values[children][np.isfinite(values[children])]
                if len(some):
                    axes.plot(curve.x, density(some, x=curve.x, reflect=folded).pdf, color=color, linewidth=1)
            low, quarter, middle, three, high = np.quantile(known, [0.001, 0.25, 0.5, 0.75, 0.999])
            high = min(high, middle + 6 * (three - quarter) + 1)  # a few far values would hide the rest
            axes.set_xlim(low - 0.4, high + 0.4)
            axes.set_ylim(bottom=0)
        sizes = zip(subsets, _SUBSETS, strict=False)
        lines = [(f"{size} at random", {"color": color, "linewidth": 1.2}) for size, color in sizes]
        sheet.legend(figure, [(f"all {run.children}", {"color": "#bbbbbb", "linewidth": 6}), *lines])
        sheet.headline(figure, sheet.run_name(run))
        return sheet.save(figure, stem)


def draw_errors(rows: Sequence[Mapping[str, Any]], run: Run, stem: Path) -> list[Path]:
    """Kolmogorov-Smirnov distance to the truth over the number of runs, one panel per metric.

    Args:
        rows: of `scex_sumo.studies.sample_size.study`.
        stem: path without ending.
    """
    designs = dict(zip(dict.fromkeys(r["design"] for r in rows), _DESIGNS, strict=False))
    sizes = sorted({int(r["size"]) for r in rows})
    with sheet.sheet(11.5, 7.2) as figure:
        for axes, column in sheet.metric_panels(figure, run.columns, labelled=False, shared=True):
            axes.loglog(sizes, [dkw_half_width(n) for n in sizes], color="#999999", linestyle=":")
            known = [r for r in rows if r["metric"] == column and r["ks_median"] is not None]
            for design, color in designs.items():
                found = [(r["size"], r["ks_median"], r["ks_p95"]) for r in known if r["design"] == design]
                if found:
                    size, middle, high = np.array(sorted(found)).T
                    axes.loglog(size, middle, color=color, marker="o", markersize=3, linewidth=1.2)
                    axes.loglog(size, high, color=color, linestyle="--", linewidth=0.9)
        sheet.left_label(figure, "KS distance to the truth")
        for axes in figure.axes[-4:]:
            axes.set_xlabel("runs")
            axes.set_xticks(sizes, [str(n) for n in sizes])
            axes.minorticks_off()
        lines = [(f"{d}: median", {"color": c, "marker": "o", "markersize": 3}) for d, c in designs.items()]
        lines.append(("95th percentile", {"color": "#555555", "linestyle": "--"}))
        lines.append(("DKW 95 %, independent draws", {"color": "#999999", "linestyle": ":"}))
        sheet.legend(figure, lines)
        sheet.headline(figure, sheet.run_name(run))
        return sheet.save(figure, stem)


def draw_effects(found: Sequence[Explanation], run: Run, stem: Path) -> list[Path]:
    """Main effects (diagonal) and pairs (beside it) of all vehicles, as SVG and PNG.

    One panel per metric of which there is something to explain.

    Args:
        found: of `scex_sumo.studies.explain.explain`, one per metric column.
        stem: path without ending.
    """
    ids = [str(t) for t in run.info["seed_scene"]["track_ids"]]
    found = [explanation for explanation in found if explanation.effects]
    with sheet.sheet(11.5, 1.0 + 2.1 * max(-(-len(found) // _WIDE), 1)) as figure:
        image = None
        panels = sheet.metric_panels(figure, [one.metric for one in found], wide=_WIDE, labelled=False)
        for (axes, _), explanation in zip(panels, found, strict=True):
            share = _shares(explanation, len(ids))
            image = axes.imshow(100 * share, cmap="Blues", vmin=0, vmax=50)
            for row, column in zip(*np.nonzero(share >= 0.01), strict=True):
                value = 100 * share[row, column]
                color = "white" if value > 30 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=color)
            axes.set_xticks(range(len(ids)), ids, rotation=90 if len(ids) > 8 else 0)
            axes.set_yticks(range(len(ids)), ids)
            rest = next(e.share for e in explanation.effects if e.kind == "rest")
            sheet.note(axes, 0.95, f"rest {100 * max(rest, 0):.0f} %")
        if image is not None:
            label = "share of the variance [%]: alone (diagonal), in pairs (below)"
            figure.colorbar(image, ax=figure.axes, shrink=0.5, label=label)
        sheet.headline(figure, sheet.run_name(run))
        return sheet.save(figure, stem)


def _shares(explanation: Explanation, vehicles: int) -> FloatArray:
    """(V, V) share of each pair below the diagonal, of each vehicle alone on it; NaN above."""
    share = np.full((vehicles, vehicles), np.nan)
    for e in explanation.effects:
        if e.kind != "rest":
            share[max(e.vehicle, e.other), e.vehicle] = max(e.share, 0.0)
    return share
