"""Report of a run: ``report.html`` in its result folder, its body, and cards of what only some runs have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from scex_sumo.base.files import write_atomic
from scex_sumo.metrics.registry import COLLISION, critical_columns, metric_of
from scex_sumo.page.charts import line_legend, metric_title, ticks, value_range
from scex_sumo.page.contents import report_contents
from scex_sumo.page.html import BASE, Html, asset, element, joined, page_html
from scex_sumo.page.study import card, table, table_place
from scex_sumo.reports.run_table import counted
from scex_sumo.results.encounters import ENCOUNTERS
from scex_sumo.results.run import Run
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.studies.under_test.results import Driven
from scex_sumo.studies.under_test.table import HEADS, under_test_rows

REPORT = "report.html"
TABLE = "under-test"
_WARNING = "warning: "
_KINDS: dict[Driven, str] = {"under_test": "picked", "baseline": "drawn"}
SCRIPTS = (
    *BASE,
    *("state.js", "chart.js", "pairs.js", "map.js", "player.js", "models.js"),
    *("selection.js", "address.js", "vehicles.js", "exact.js", "parts.js", "report.js"),
)


def write_report(run: Run, scene: SeedScene | None = None) -> Path:
    """Write the report of a finished run into its folder and return its path."""
    path = run.folder / REPORT
    write_atomic(path, report_html(run, scene).encode())
    return path


def report_html(run: Run, scene: SeedScene | None = None) -> str:
    """Return the report of a run as HTML."""
    return filled_report(run, *report_contents(run, scene))


def filled_report(run: Run, info: dict[str, Any], arrays: dict[str, Any]) -> str:
    """Return the report as HTML from the result of `report_contents`."""
    is_tested = run.baseline is not None and run.info.get("under_test")
    tables = {TABLE: table(HEADS, under_test_rows(run.under_test))} if is_tested else {}
    body = run_body(info, under_test_card(run), *exact_card(run))
    more: dict[str, Any] = {"tables": tables, "exact": exact_contents(run)}
    more |= {"tested_curves": under_test_curves(run) if is_tested else []}
    return page_html(info["name"], body, SCRIPTS, info | more, arrays)


def under_test_card(run: Run) -> Html:
    """Return the card of the driver under test; empty without one or without a baseline."""
    if run.baseline is None or not run.info.get("under_test"):
        return Html()
    return card(
        f"Under test, {run.under_test.label}",
        "Only encounters of the vehicles under test count. Without: the same futures and other drivers, with "
        "these vehicles driven as drawn. Curves: share of the futures up to a value, with its 95 % band.",
        table_place(TABLE),
        line_legend([("picked", "with the driver under test"), ("drawn", "without")]),
        element("div.charts", id="tested-curves"),
    )


def under_test_curves(run: Run) -> list[dict[str, Any]]:
    """Return by metric the values with the driver under test and without, and half-widths of their bands."""
    tested, found = run.under_test, []
    for column in critical_columns(tested.columns):
        if column == COLLISION:
            continue
        limit, sets, values = run.thresholds.get(column), [], []
        for driven, kind in _KINDS.items():
            values.append(tested.samples(column, driven))
            if np.isfinite(values[-1]).any():
                curve = tested.density(column, driven)
                band = float((curve.band[1] - curve.cdf).max())
                sets.append({"kind": kind, "values": values[-1].tolist(), "band": band})
        view = value_range(np.concatenate(values), limit)
        about = {"title": metric_title(column), "side": metric_of(column).side, "threshold": limit}
        found.append(about | {"view": view, "ticks": ticks(*view), "sets": sets})
    return found


def exact_contents(run: Run) -> dict[str, Any] | None:
    """Return models, shares and the cut sets of the pairs that collide; None without exact tables.

    ``pairs`` have their ``cubes``, lists of track id and model's index; None if sampled.
    """
    exact = run.exact
    if exact is None or not (run.folder / ENCOUNTERS).is_file():
        return None
    pairs = []
    for row in run.encounters.to_pylist():
        table = exact.table(row["track_id"], row["other_id"])
        if row["collision"] == 0 and (table is None or table.probability() == 0):
            continue
        cubes = None if table is None else [sorted(cube) for cube in table.cut_sets]
        name, words = f"{row['track_id']} → {row['other_id']}", [] if table is None else table.in_words()
        pairs.append(
            {"name": name, "cubes": cubes, "words": "; or ".join(words), "sampled": row["collision"]}
        )
    return {"models": list(exact.models), "shares": exact.shares.tolist(), "pairs": pairs}


def exact_card(run: Run) -> list[Html]:
    """Return the card with the sliders; none where no pair collides or no table is exact."""
    contents = exact_contents(run)
    if contents is None or not contents["pairs"] or run.exact is None:
        return []
    sliders = [
        element(
            "label.weight",
            element("span", model),
            element("input", type="range", min="0", max="1", step="any", data_model=number),
            element("output"),
        )
        for number, model in enumerate(contents["models"])
    ]
    about = f"{run.exact.told().capitalize()}. Drag a weight: P follows without new futures."
    return [
        element(
            "section.card",
            element("h2", "Exact probabilities"),
            element("p.soft", about),
            element("div", *sliders, id="weights"),
            element("div.row", element("button", "the run's weights", id="own-weights")),
            element("p", "Any collision: ", element("b", id="any-collision")),
            element("div.scroll", id="exact-table"),
            id="exact",
        )
    ]


def run_body(info: Mapping[str, Any], *cards: Html) -> str:
    """Return the body from the info of `report_contents`, with more cards before the notes."""
    place = info["location"] if info["location"] != info["name"] else ""
    about = [
        counted(len(info["track_ids"]), "vehicle"),
        counted(info["children"], "future"),
        f"{info['steps'] * STEP_S:.1f} s ahead",
        place,
    ]
    notes = info["notes"]
    warnings = [note.removeprefix(_WARNING) for note in notes if note.startswith(_WARNING)]
    return Template(asset("report.html")).substitute(
        name=element("span", info["name"]),
        about=joined(" · ".join(part for part in about if part)),
        warnings=_note_card("Warnings", warnings),
        verdict=joined(_collision_card(info), _encounter_card(info), _share_card(info)),
        recorded="" if info["has_recorded"] else " hidden",
        notes=joined(*cards, _note_card("Notes", [n for n in notes if not n.startswith(_WARNING)])),
        foot=joined(f"scex-sumo {info['version']} · {info['command']}"),
    )


def percent(share: float) -> str:
    """Return a share in percent, small ones with one decimal."""
    return f"{100 * share:.{1 if 0 < share < 0.0995 else 0}f} %"


def _collision_card(info: Mapping[str, Any]) -> Html:
    share, likely = info["collision"], info["likely_collisions"]
    if share is None:
        words = element("p.soft", "not in this result; run it again")
        return element("div.card", element("h2", "P(collision)"), element("div.big", "–"), words)
    parts = [_big(share, "stress test", "driven as any of the models", "p-collision", "drawn")]
    if likely is not None:
        parts.append(
            _big(likely, "human-like", "driven as people were recorded", "likely-collision", "likely")
        )
    return element("div.card", element("h2", "P(collision)"), element("div.sets", *parts))


def _big(share: Mapping[str, Any], what: str, how: str, name: str, kind: str) -> Html:
    exact, interval = share["exact"], f"{percent(share['low'])} – {percent(share['high'])}"
    value = percent(share["value"]) if exact is None else f"{100 * exact:.4g} %"
    seen = f"{share['count']} of {counted(share['children'], 'future')}"
    words = f"{seen}; 95 %: {interval}" if exact is None else f"exact; sampled: {seen}, {interval}"
    number = element("div.big.hot" if share["count"] else "div.big", value, id=name, title=value)
    hurt = share["injuries"]
    severe = [] if hurt is None else [f"; {1000 * hurt:.2f} severe injuries (MAIS 3+) in 1000 futures"]
    counts = element("span", words, id=f"{name}-words", title=words)
    return element(
        "div", number, element("p.soft", element(f"b.{kind}", what), f", {how}: ", counts, *severe)
    )


def _share_card(info: Mapping[str, Any]) -> Html:
    about = element("p.soft", _recorded_words(info["metrics"]))
    whoever = f"Always so in this traffic: {', '.join(info['always'])}."
    always = [element("p", whoever)] if info["always"] else []
    always += [element("p", f"{info['above'][:1].upper()}{info['above'][1:]}.")] if info["above"] else []
    return element("div.card", element("h2", "P(critical)"), element("div", id="shares"), about, *always)


def _recorded_words(metrics: Sequence[Mapping[str, Any]]) -> str:
    judged = [m for m in metrics if None not in (m["recorded"], m["threshold"]) and not m["mean"]]
    if not judged:
        return "What really happened was not recorded."
    names = [
        f"{m['name']} {m['sign']} {m['threshold']:.3g} {m['unit']}".rstrip()
        for m in judged
        if (m["recorded"] <= m["threshold"] if m["side"] == "left" else m["recorded"] >= m["threshold"])
    ]
    return (
        f"The recorded future had {', '.join(names)}." if names else "The recorded future was not critical."
    )


def _encounter_card(info: Mapping[str, Any]) -> Html:
    is_critical = any(row["worst"] for row in info["encounters"]["rows"])
    about = "A vehicle hits or follows → another; how, where, when; share of all futures; drivers."
    parts = [
        element("p.soft", about if is_critical else "No pair of vehicles has a critical encounter."),
        element("ol", id="worst-encounters"),
    ]
    parts += [element("p", info["tested"])] if info["tested"] else []
    return element("div.card", element("h2", "Worst encounters"), *parts)


def _note_card(title: str, notes: Sequence[str]) -> Html:
    if not notes:
        return Html()
    lines = element("ul", *(element("li", note) for note in notes), id=title.lower())
    return element("section.card", element("h2", title), lines)
