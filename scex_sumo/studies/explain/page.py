"""Page of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.page.figures.charts import metric_title
from scex_sumo.page.html import Html, element
from scex_sumo.page.study import Column, Table, card, page_table, plots, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.results.run import Run
from scex_sumo.studies.explain.effects import Condition
from scex_sumo.studies.explain.explain import BEYOND, WORST_SHARE, Explanation, pair_of, undefined

HTML = "explain.html"
_CELL_PX = 26
_MARGIN_PX = 34
_FULL = 0.5
"""Share of the variance at which a cell is darkest."""


def write_explanations(
    run: Run,
    explanations: Sequence[Explanation],
    names: Sequence[str],
    worst: Mapping[str, Sequence[Mapping[str, Any]]],
) -> Path:
    """Write the page into the run's folder, with model ``names`` and ``worst`` rows by metric."""
    ids = [int(track) for track in run.info["seed_scene"]["track_ids"]]
    said = [
        _sentences(explanation, ids, names)
        for explanation in explanations
        if explanation.given and not explanation.always
    ]
    metrics = [
        explanation
        for explanation in explanations
        if explanation.metric in run.columns and not explanation.metric.endswith("_mean")
    ]
    drawn = [_matrix(explanation, ids) for explanation in metrics if len(explanation.effects) > 1]
    cards = [
        card("What makes it critical", *said),
        card(
            "Which models matter",
            "Share of the variance between the futures, in percent: from the model of one vehicle "
            "(diagonal) and of two together (below it). "
            f"Values beyond {BEYOND:g} times a threshold count as that. "
            "The rest to 100 % is not explained: three or more vehicles together, random routes, or effects "
            "too small for so many futures.",
            plots(*drawn) if drawn else "No effect of a model is beyond chance.",
        ),
        card("Models that make it more critical", table_place("conditions")),
        card("Most critical futures", table_place("worst")),
    ]
    tables = {
        "conditions": _conditions(explanations, ids, names),
        "worst": page_table(_WORST, [row for rows in worst.values() for row in rows]),
    }
    scene = run.info["seed_scene"]
    about = f"{counted(scene['vehicles'], 'vehicle')}, {counted(run.futures, 'future')}"
    return write_study(
        run.folder / HTML, f"Which models make it critical: {scene['name']}", about, *cards, tables=tables
    )


def _question(explanation: Explanation) -> str:
    return explanation.question(_titled(explanation.metric), ("≤", "≥"))


def _sentences(explanation: Explanation, ids: Sequence[int], names: Sequence[str]) -> Html:
    if not explanation.defined:
        return element("p", f"{_titled(explanation.metric)}: {undefined(explanation)}.")
    rules = [
        element(
            "li",
            f"{rule.share:.0%} with {_models(rule, ids, names)} (95 %: {rule.low:.0%} – {rule.high:.0%}); "
            f"that is {rule.covered:.0%} of all critical futures",
        )
        for rule in explanation.rules
    ]
    head = element("b", f"{explanation.p_critical.percent} of the futures have {_question(explanation)}.")
    return element("div", element("p", head), *([element("ul", *rules)] if rules else []))


def _models(rule: Condition, ids: Sequence[int], names: Sequence[str]) -> str:
    pairs = zip(rule.vehicles, rule.models, strict=True)
    return " and ".join(f"{ids[vehicle]} as {names[model]}" for vehicle, model in pairs)


_CONDITIONS = (
    Column("question", "critical if"),
    Column("models", "models", "words"),
    Column("share", "share", "percent", "Critical share of the futures with these models"),
    Column("all", "all futures", "percent", "Critical share of all futures"),
    Column("low", "from", "percent", "95 % confidence interval of the share"),
    Column("high", "to", "percent", "95 % confidence interval of the share"),
    Column("covered", "of the critical", "percent", "Share of all critical futures that have these models"),
)
_WORST = (
    Column(lambda row: _titled(row["metric"]), "metric"),
    Column("future", "future"),
    Column("value", "value", "real"),
    Column(
        lambda row: " – ".join(str(row[k]) for k in ("track_id", "other_id") if row[k] is not None) or None,
        "vehicles",
    ),
    Column("after_s", "after", "seconds"),
    Column("assignment", "models", "words"),
)


def _titled(metric: str) -> str:
    return metric if metric == COLLISION or pair_of(metric) else metric_title(metric)


def _conditions(explanations: Sequence[Explanation], ids: Sequence[int], names: Sequence[str]) -> Table:
    rows = [
        vars(c)
        | {
            "question": _question(explanation),
            "models": _models(c, ids, names),
            "all": explanation.p_critical.estimate.value,
        }
        for explanation in explanations
        if explanation.given
        or explanation.p_critical.estimate.value <= 2 * WORST_SHARE  # else many share the value of the tenth
        for c in explanation.conditions
    ]
    return page_table(_CONDITIONS, sorted(rows, key=lambda row: -row["share"]))


def _matrix(explanation: Explanation, ids: Sequence[int]) -> Html:
    effects = [effect for effect in explanation.effects if effect.kind != "rest"]
    vehicles = sorted({effect.vehicle for effect in effects} | {max(e.other, e.vehicle) for e in effects})
    share: FloatArray = np.zeros((len(ids), len(ids)))
    for effect in effects:
        share[max(effect.vehicle, effect.other), effect.vehicle] = effect.share
    share, ids = share[np.ix_(vehicles, vehicles)], [ids[vehicle] for vehicle in vehicles]
    parts = []
    for row, track in enumerate(ids):
        y = row * _CELL_PX
        parts.append(element("text", str(track), x=_MARGIN_PX - 5, y=y + 17, text_anchor="end"))
        foot = len(ids) * _CELL_PX + 13
        parts.append(
            element("text", str(track), x=_MARGIN_PX + y + _CELL_PX // 2, y=foot, text_anchor="middle")
        )
        for column in range(row + 1):
            parts += _cell(_MARGIN_PX + column * _CELL_PX, y, share[row, column])
    side = len(ids) * _CELL_PX
    drawing = element("svg.plot.matrix", *parts, viewBox=f"0 0 {side + _MARGIN_PX} {side + 18}", role="img")
    return element("figure", element("figcaption", metric_title(explanation.metric)), drawing)


def _cell(x: int, y: int, share: float) -> list[Html]:
    ink = f"{min(share / _FULL, 1.0):.2f}"
    size = _CELL_PX - 1
    elements = [element("rect.cell", x=x, y=y, width=size, height=size, fill_opacity=ink)]
    if share >= 0.01:
        kind = "text.light" if share > 0.3 else "text.dark"
        elements.append(element(kind, f"{100 * share:.0f}", x=x + size // 2, y=y + 17, text_anchor="middle"))
    return elements
