"""Pictures of what the numbers of runs and the assignments do to the densities. Loads matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.reports.run_pictures import axis_label, panel_grid, panel_title
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import density, dkw_half_width
from scex_sumo.studies.explain import Explanation

_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "scex-sumo",
    "figure.dpi": 100,
}
_SUBSETS = ("#1f4e79", "#2e8b57", "#d98c21", "#c0392b", "#7d3c98")
_DESIGNS = ("#1f4e79", "#c0392b", "#2e8b57", "#d98c21", "#7d3c98", "#555555")


def draw_subsets(run: Run, subsets: Mapping[int, IntArray], stem: Path) -> list[Path]:
    """Density of every metric over all children, and over one subset of each size, as SVG and PNG.

    Args:
        run: all assignments.
        subsets: children of one subset by size.
        stem: path without ending.
    """
    with plt.rc_context(_STYLE):
        figure, grid = panel_grid(len(run.columns))
        for axes, column in zip(grid.flat, run.columns, strict=False):
            axes.set_xlabel(axis_label(column))
            axes.set_title(panel_title(column), loc="left")
            values = _values(run, column)
            known = values[np.isfinite(values)]
            if len(known) == 0:
                axes.text(0.5, 0.5, "defined in no child", ha="center", va="center", transform=axes.transAxes)
                continue
            curve = density(known)
            axes.fill_between(curve.x, curve.pdf, color="#bbbbbb", linewidth=0)
            for (_, children), color in zip(subsets.items(), _SUBSETS, strict=False):
                some = values[children][np.isfinite(values[children])]
                if len(some):
                    axes.plot(curve.x, density(some, x=curve.x).pdf, color=color, linewidth=1)
            low, quarter, middle, three, high = np.quantile(known, [0.001, 0.25, 0.5, 0.75, 0.999])
            high = min(high, middle + 6 * (three - quarter) + 1)  # a few far values would hide the rest
            axes.set_xlim(low - 0.4, high + 0.4)
            axes.set_ylim(bottom=0)
        handles = [Line2D([], [], color="#bbbbbb", linewidth=6)]
        handles += [Line2D([], [], color=c, linewidth=1.2) for _, c in zip(subsets, _SUBSETS, strict=False)]
        labels = [f"all {run.children}", *(f"{size} at random" for size in subsets)]
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
        _headline(figure, run)
        return _save(figure, stem)


def draw_errors(rows: Sequence[Mapping[str, Any]], run: Run, stem: Path) -> list[Path]:
    """Kolmogorov-Smirnov distance to the truth over the number of runs, one panel per metric.

    Args:
        rows: of `scex_sumo.studies.sample_size.study`.
        run: all assignments.
        stem: path without ending.
    """
    designs = list(dict.fromkeys(r["design"] for r in rows))
    sizes = sorted({int(r["size"]) for r in rows})
    with plt.rc_context(_STYLE):
        figure, grid = panel_grid(len(run.columns), sharex=True, sharey=True)
        for axes, column in zip(grid.flat, run.columns, strict=False):
            axes.set_title(panel_title(column), loc="left")
            axes.loglog(sizes, [dkw_half_width(n) for n in sizes], color="#999999", linestyle=":")
            for design, color in zip(designs, _DESIGNS, strict=False):
                found = [
                    (r["size"], r["ks_median"], r["ks_p95"])
                    for r in rows
                    if r["metric"] == column and r["design"] == design and r["ks_median"] is not None
                ]
                if found:
                    size, middle, high = np.array(sorted(found)).T
                    axes.loglog(size, middle, color=color, marker="o", markersize=3, linewidth=1.2)
                    axes.loglog(size, high, color=color, linestyle="--", linewidth=0.9)
        for axes in grid[:, 0]:
            axes.set_ylabel("KS distance to the truth")
        for axes in grid[-1]:
            axes.set_xlabel("runs")
            axes.set_xticks(sizes, [str(n) for n in sizes])
            axes.minorticks_off()
        handles = [Line2D([], [], color=c, marker="o", markersize=3) for c in _DESIGNS[: len(designs)]]
        handles += [
            Line2D([], [], color="#555555", linestyle="--"),
            Line2D([], [], color="#999999", linestyle=":"),
        ]
        labels = [*(f"{d}: median" for d in designs), "95th percentile", "DKW 95 %, independent draws"]
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
        _headline(figure, run)
        return _save(figure, stem)


def _values(run: Run, column: str) -> FloatArray:
    return np.asarray(run.metrics[column].to_numpy(zero_copy_only=False), dtype=np.float64)


def _headline(figure: Any, run: Run) -> None:
    scene = run.info["seed_scene"]
    figure.suptitle(f"{scene['name']}   {scene['vehicles']} vehicles", x=0.01, ha="left", fontsize=10)


def _save(figure: Any, stem: Path) -> list[Path]:
    files = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    figure.savefig(files[0], metadata={"Date": None})
    figure.savefig(files[1], dpi=150)
    plt.close(figure)
    return files


def draw_effects(found: Sequence[Explanation], run: Run, stem: Path) -> list[Path]:
    """Main effects (diagonal) and pairs (beside it) of all vehicles, one panel per metric, as SVG and PNG.

    Args:
        found: of `scex_sumo.studies.explain.explain`, one per metric column.
        run: the run explained.
        stem: path without ending.
    """
    ids = [str(t) for t in run.info["seed_scene"]["track_ids"]]
    with plt.rc_context(_STYLE):
        figure, grid = plt.subplots(3, 4, figsize=(11.5, 8.8), layout="constrained")
        image = None
        for axes, explanation in zip(grid.flat, found, strict=True):
            axes.set_title(panel_title(explanation.metric), loc="left")
            if not explanation.effects:
                axes.text(0.5, 0.5, "nothing to explain", ha="center", va="center", transform=axes.transAxes)
                axes.set(xticks=[], yticks=[])
                continue
            share = np.full((len(ids), len(ids)), np.nan)
            for e in explanation.effects:
                if e.kind != "rest":
                    share[max(e.vehicle, e.other), e.vehicle] = max(e.share, 0.0)
            image = axes.imshow(100 * share, cmap="Blues", vmin=0, vmax=50)
            for row, column in zip(*np.nonzero(share >= 0.01), strict=True):
                value = 100 * share[row, column]
                color = "white" if value > 30 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=color)
            axes.set_xticks(range(len(ids)), ids, rotation=90 if len(ids) > 8 else 0)
            axes.set_yticks(range(len(ids)), ids)
            rest = next(e.share for e in explanation.effects if e.kind == "rest")
            axes.text(
                0.98,
                0.95,
                f"rest {100 * max(rest, 0):.0f} %",
                ha="right",
                va="top",
                transform=axes.transAxes,
                color="#666666",
            )
        if image is not None:
            label = "share of the variance [%]: alone (diagonal), in pairs (below)"
            figure.colorbar(image, ax=grid, shrink=0.5, label=label)
        _headline(figure, run)
        return _save(figure, stem)
