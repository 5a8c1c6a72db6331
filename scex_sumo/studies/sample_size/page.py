"""Page of a study of the sample size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.page.figures.charts import Plane, density_plot, line_legend, metric_title, value_range
from scex_sumo.page.html import Html
from scex_sumo.page.study import Column, card, page_table, plots, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Density, density, dkw_half_width

HTML = "sample_size.html"
_KINDS = ("critical", "picked", "likely", "c4", "c5")
_MIN_ERROR = 1e-3
"""Least distance on the logarithmic axis."""


def write_sample_size(
    run: Run, rows: Sequence[Mapping[str, Any]], subsets: Mapping[int, IntArray], path: Path
) -> Path:
    """Write the page of rows of `scex_sumo.studies.sample_size.sample_size.study`."""
    draws = rows[0]["draws"] if rows else 0
    designs = list(dict.fromkeys(row["design"] for row in rows))
    scene, columns = run.info["seed_scene"], [name for name in run.columns if not name.endswith("_mean")]
    sizes = dict(zip(subsets, _KINDS, strict=False))
    errors = dict(zip(designs, _KINDS, strict=False))
    how_far = card(
        "How far samples are from all assignments",
        "The largest difference of the shares of futures at or below any value (Kolmogorov-Smirnov): of "
        f"{draws} samples of each size the median, and the size that 95 % of them stay below (dashed).",
        line_legend(
            [*((kind, name) for name, kind in errors.items()), ("soft", "known bound, independent draws")]
        ),
        plots(*(_errors(rows, column, errors) for column in columns)),
    )
    what = card(
        "What samples look like",
        f"Density over all {run.futures} assignments, and over one sample of each size.",
        line_legend([("drawn", f"all {run.futures}"), *((kind, f"{size}") for size, kind in sizes.items())]),
        plots(*(_densities(run, column, subsets) for column in columns)),
    )
    about = f"{counted(scene['vehicles'], 'vehicle')}, all {run.futures} assignments of models"
    numbers = card(
        "In numbers",
        "Also of the means over a future. KS, W1, JSD: three distances of a sample from all assignments.",
        table_place("sizes"),
    )
    title, tables = f"How many futures are enough: {scene['name']}", {"sizes": page_table(COLUMNS, rows)}
    return write_study(path, title, about, how_far, what, numbers, tables=tables)


COLUMNS = (
    Column(lambda row: metric_title(row["metric"]), "metric"),
    Column("design", "design"),
    Column("size", "futures"),
    *(
        Column(f"{kind}_{end}", f"{kind.upper()} {words}", "real")
        for kind in ("ks", "w1", "jsd")
        for end, words in (("median", "median"), ("p95", "95 %"))
    ),
)
"""Columns of the table of rows."""


def _errors(rows: Sequence[Mapping[str, Any]], column: str, kinds: Mapping[str, str]) -> Html:
    known = [row for row in rows if row["metric"] == column and row["ks_median"] is not None]
    sizes = sorted({int(row["size"]) for row in rows})
    span_x = (np.log10(sizes[0]) - 0.05, np.log10(sizes[-1]) + 0.05) if sizes else (0.0, 1.0)
    plane = Plane(x=(float(span_x[0]), float(span_x[1])), y=(-2.5, 0.0))
    bound = np.array([dkw_half_width(size) for size in sizes])
    parts = [plane.line(np.log10(sizes), np.log10(bound), "soft")] if known else []
    for design, kind in kinds.items():
        errors = sorted((r["size"], r["ks_median"], r["ks_p95"]) for r in known if r["design"] == design)
        if not errors:
            continue
        size, middle, high = np.log10(np.maximum(np.array(errors, dtype=float).T, _MIN_ERROR))
        parts += [plane.line(size, middle, kind), plane.line(size, high, kind, dashed=True)]
        parts += [
            plane.dot(x, y, kind, title=f"{10**x:.0f} futures: {10**y:.3f}")
            for x, y in zip(size.tolist(), middle.tolist(), strict=True)
        ]
    parts += [plane.words(plane.x[0], y, f"{10**y:g}", anchor="start") for y in (-2.0, -1.0)]
    marks = [(float(np.log10(size)), str(size)) for size in sizes]
    return plane.figure(metric_title(column), *parts, marks=marks)


def _densities(run: Run, column: str, subsets: Mapping[int, IntArray]) -> Html:
    values = run.values(column)
    x = value_range(values)
    samples = [values[futures] for futures in subsets.values()]
    curves = [
        (kind, _density(one)) for kind, one in zip(("drawn", *_KINDS), [values, *samples], strict=False)
    ]
    return density_plot(column, curves, x)


def _density(values: FloatArray) -> Density | None:
    finite = values[np.isfinite(values)]
    return density(finite, reflect=bool(finite.min() >= 0)) if finite.size else None
