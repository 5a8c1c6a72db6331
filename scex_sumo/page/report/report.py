"""Report of a run: ``report.html`` in its result folder, its body, and cards of what only some runs have."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from scex_sumo.base.files import write_atomic
from scex_sumo.page.html import BASE, Html, asset, element, joined, page_html
from scex_sumo.page.parts import PagePart
from scex_sumo.page.report.contents import report_contents
from scex_sumo.page.study import table_place
from scex_sumo.reports.card import title, verdict_lines
from scex_sumo.reports.run_table import row_cell
from scex_sumo.results.extras import VERDICTS, extras_results
from scex_sumo.results.run import PAGE, Run
from scex_sumo.scene import SeedScene

_WARNING = "warning: "
_WIDE = 10_000  # no line of the answer is broken
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
    body = run_body(run, info, parts)
    tables = {name: table for part in parts for name, table in part.tables.items()}
    more = {name: value for part in parts for name, value in part.info.items()}
    scripts = dict.fromkeys([*SCRIPTS, *(name for part in parts for name in part.scripts)])
    return page_html(info["name"], body, tuple(scripts), info | more | {"tables": tables}, arrays)


def run_body(run: Run, info: Mapping[str, Any], parts: Sequence[PagePart] = ()) -> str:
    """Return the body from the info of `report_contents`, with the cards of extras."""
    notes = info["notes"]
    warnings = [note.removeprefix(_WARNING) for note in notes if note.startswith(_WARNING)]
    told = _note_card("Notes", [note for note in notes if not note.startswith(_WARNING)])
    return Template(asset("report.html")).substitute(
        name=joined(title(run)),
        warnings=_note_card("Warnings", warnings),
        answer=_answer(run),
        pairs=_pairs(info, parts),
        rows=joined(*_rows(info)),
        recorded="" if info["has_recorded"] else " hidden",
        notes=joined(*(card for part in parts for card in part.cards), told),
        foot=joined(f"scex-sumo {info['version']} · {info['command']}"),
    )


def _answer(run: Run) -> Html:
    """Return the verdict in words, as the terminal prints it."""
    first, *more = (line.plain for line in verdict_lines(run, wide=_WIDE))
    told = run.decision
    word = VERDICTS[told.kind].upper() if told is not None else ""
    head = element("p", element(f"b.{told.kind if told is not None else ''}", word), first[len(word) :])
    return element("section", head, *(element("p.soft", line) for line in more), id="answer")


def _pairs(info: Mapping[str, Any], parts: Sequence[PagePart]) -> Html:
    """Return the place of the pairs, and how one looks at the first pair in SUMO."""
    tested = [element("p", part.verdict) for part in parts if part.verdict]
    look = element("p.soft", "look: ", element("code", f"scex-sumo view {shlex.quote(str(info['folder']))}"))
    return element("div.card", table_place("pairs"), *tested, look)


def _rows(info: Mapping[str, Any]) -> list[Html]:
    return [element("p.soft", _row(name, values)) for name, values in info["rows"].items()]


def _row(name: str, values: Sequence[float | str | None]) -> str:
    """Return the row of an extra: its value in the stress test, then in the human-like futures."""
    kinds = zip(values, ("stress test", "human-like"), strict=False)
    return f"{name}: {', '.join(f'{row_cell(value)} {kind}' for value, kind in kinds if value is not None)}"


def _note_card(name: str, notes: Sequence[str]) -> Html:
    if not notes:
        return Html()
    lines = element("ul", *(element("li", note) for note in notes), id=name.lower())
    if name == "Notes":
        return element("details.card", element("summary", name), lines)
    return element("section.card", element("h2", name), lines)
