"""Report of a run: ``report.html`` in its result folder, its body, and cards of what only some runs have."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scex_sumo.base.files import write_atomic
from scex_sumo.page.document import Document, card
from scex_sumo.page.html import Html, element, joined
from scex_sumo.page.report.contents import report_contents
from scex_sumo.reports.card import title, verdict_lines
from scex_sumo.reports.words import row_cell
from scex_sumo.results.decision import VERDICTS
from scex_sumo.results.info import PAGE
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene

_WARNING = "warning: "
_WIDE = 10_000  # no line of the answer is broken
SCRIPTS = (
    *("state.js", "chart.js", "pairs.js", "map.js", "player.js", "models.js"),
    *("selection.js", "address.js", "vehicles.js", "parts.js", "report.js"),
)


def write_report(run: Run, scene: SeedScene | None = None) -> Path:
    """Write the report of a finished run into its folder and return its path."""
    path = run.folder / PAGE
    write_atomic(path, filled_report(run, *report_contents(run, scene)))
    return path


def filled_report(run: Run, info: dict[str, Any], arrays: dict[str, Any]) -> bytes:
    """Return the report as HTML from the result of `report_contents`."""
    page = Document(info["name"], *SCRIPTS)
    page.info, page.arrays = page.info | info, arrays
    warnings = [note.removeprefix(_WARNING) for note in info["notes"] if note.startswith(_WARNING)]
    notes = _note_card("Notes", [note for note in info["notes"] if not note.startswith(_WARNING)])
    verdict = ""
    if run.info.get("under_test") and run.baseline is not None:
        from scex_sumo.page.report.under_test import under_test_part

        verdict, about = under_test_part(page, run)
        notes = joined(about, notes)
    return page.filled(
        "report.html",
        name=title(run),
        warnings=_note_card("Warnings", warnings),
        answer=_answer(run),
        pairs=_pairs(info, verdict),
        rows=joined(*(_row(name, values) for name, values in info["rows"].items())),
        recorded="" if info["has_recorded"] else " hidden",
        notes=notes,
        foot=f"scex-sumo {info['version']} · {info['command']}",
    )


def _answer(run: Run) -> Html:
    first, *more = (line.plain for line in verdict_lines(run, wide=_WIDE))
    kind = "" if run.decision is None else run.decision.kind
    word = VERDICTS[kind].upper() if kind else ""
    head = element("p", element(f"b.{kind}", word), first[len(word) :])
    return element("section", head, *(element("p.soft", line) for line in more), id="answer")


def _pairs(info: Mapping[str, Any], verdict: str) -> Html:
    """Return the place of the pairs, and how one looks at the first pair in SUMO."""
    tested = [element("p", verdict)] if verdict else []
    look = element("p.soft", "look: ", element("code", f"scex-sumo view {shlex.quote(str(info['folder']))}"))
    return element("div.card", element("div.scroll", id="pairs"), *tested, look)


def _row(name: str, values: Sequence[float | str | None]) -> Html:
    """Return the row of an extra: its value in the stress test, then in the human-like futures."""
    kinds = zip(values, ("stress test", "human-like"), strict=False)
    words = ", ".join(f"{row_cell(value)} {kind}" for value, kind in kinds if value is not None)
    return element("p.soft", f"{name}: {words}")


def _note_card(name: str, notes: Sequence[str]) -> Html:
    if not notes:
        return Html()
    lines = element("ul", *(element("li", note) for note in notes), id=name.lower())
    if name == "Notes":
        return element("details.card", element("summary", name), lines)
    return card(name, lines)
