"""Report of a run: ``report.html`` in its result folder, its body, and cards of what only some runs have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from scex_sumo.base.files import write_atomic
from scex_sumo.page.html import BASE, Html, asset, element, joined, page_html
from scex_sumo.page.parts import PagePart
from scex_sumo.page.report.contents import report_contents
from scex_sumo.reports.run_table import counted, row_cell
from scex_sumo.results.extras import extras_results
from scex_sumo.results.run import PAGE, Run
from scex_sumo.scene import STEP_S, SeedScene

_WARNING = "warning: "
SCRIPTS = (
    *BASE,
    *("state.js", "chart.js", "pairs.js", "map.js", "player.js", "models.js"),
    *("selection.js", "address.js", "vehicles.js", "parts.js", "report.js"),
)


def write_report(run: Run, scene: SeedScene | None = None) -> Path:
    """Write the report of a finished run into its folder and return its path."""
    path = run.folder / PAGE
    write_atomic(path, report_html(run, scene).encode())
    return path


def report_html(run: Run, scene: SeedScene | None = None) -> str:
    """Return the report of a run as HTML."""
    return filled_report(run, *report_contents(run, scene))


def filled_report(run: Run, info: dict[str, Any], arrays: dict[str, Any]) -> str:
    """Return the report as HTML from the result of `report_contents`."""
    parts: list[PagePart] = [
        part for extra in extras_results(run.folder) if (part := extra.page(run)) is not None
    ]
    info = info | {"tested": " ".join(part.verdict for part in parts if part.verdict)}
    body = run_body(info, parts)
    tables = {name: table for part in parts for name, table in part.tables.items()}
    more = {name: value for part in parts for name, value in part.info.items()}
    scripts = dict.fromkeys([*SCRIPTS, *(name for part in parts for name in part.scripts)])
    return page_html(info["name"], body, tuple(scripts), info | more | {"tables": tables}, arrays)


def run_body(info: Mapping[str, Any], parts: Sequence[PagePart] = ()) -> str:
    """Return the body from the info of `report_contents`, with the cards of extras."""
    place = info["location"] if info["location"] != info["name"] else ""
    about = [
        info["participants"],
        counted(info["futures"], "future"),
        f"{info['steps'] * STEP_S:.1f} s ahead",
        place,
    ]
    notes = info["notes"]
    warnings = [note.removeprefix(_WARNING) for note in notes if note.startswith(_WARNING)]
    told = _note_card("Notes", [note for note in notes if not note.startswith(_WARNING)])
    return Template(asset("report.html")).substitute(
        name=element("span", info["name"]),
        about=joined(" · ".join(part for part in about if part)),
        warnings=joined(_decision_line(info), _note_card("Warnings", warnings)),
        verdict=joined(
            *(card for part in parts for card in part.first),
            *(_collision_card(info), _encounter_card(info), _share_card(info)),
        ),
        recorded="" if info["has_recorded"] else " hidden",
        notes=joined(*(card for part in parts for card in part.cards), told),
        foot=joined(f"scex-sumo {info['version']} · {info['command']}"),
    )


def _decision_line(info: Mapping[str, Any]) -> Html:
    return element("p", info["decision"], id="decision") if info["decision"] else Html()


def _collision_card(info: Mapping[str, Any]) -> Html:
    share, likely = info["collision"], info["likely_collisions"]
    if share is None:
        words = element("p.soft", "not in this result; run it again")
        return element("div.card", element("h2", "P(collision)"), element("div.big", "–"), words)
    parts = [_big(share, "stress test", "p-collision", "drawn")]
    if likely is not None:
        parts.append(_big(likely, "human-like", "likely-collision", "likely"))
    rows = [element("p.soft", _row(name, values)) for name, values in info["rows"].items()]
    return element("div.card", element("h2", "P(collision)"), element("div.sets", *parts), *rows)


def _row(name: str, values: Sequence[float | str | None]) -> str:
    """Return the row of an extra: its value in the stress test, then in the human-like futures."""
    kinds = zip(values, ("stress test", "human-like"), strict=False)
    return f"{name}: {', '.join(f'{row_cell(value)} {kind}' for value, kind in kinds if value is not None)}"


def _big(share: Mapping[str, Any], what: str, name: str, kind: str) -> Html:
    value, interval = share["percent"], share["range"]
    seen = f"{share['count']} of {counted(share['futures'], 'future')}"
    words = f"{seen}; 95 %: {interval}"
    number = element("div.big.hot" if share["count"] else "div.big", value, id=name, title=value)
    hurt = share["injuries"]
    severe = [] if hurt is None else [f"; {1000 * hurt:.2f} severe injuries (MAIS 3+) in 1000 futures"]
    counts = element("span", words, id=f"{name}-words", title=words)
    return element(
        "div",
        number,
        element("p.soft", element(f"b.{kind}", what), f", {share['driven']}: ", counts, *severe),
    )


def _share_card(info: Mapping[str, Any]) -> Html:
    about = element("p.soft", _recorded_words(info["metrics"]))
    return element("div.card", element("h2", "P(critical)"), element("div", id="shares"), about)


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
    return element("div.card", element("h2", "Worst encounters in the futures"), *parts)


def _note_card(title: str, notes: Sequence[str]) -> Html:
    if not notes:
        return Html()
    lines = element("ul", *(element("li", note) for note in notes), id=title.lower())
    return element("section.card", element("h2", title), lines)
