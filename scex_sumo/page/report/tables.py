"""Tables of a report: encounters, collisions, worst events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scex_sumo.metrics.events import EVENTS
from scex_sumo.page.document import table
from scex_sumo.reports.card import any_cells, decided_line, pair_lines
from scex_sumo.reports.encounter_rows import HEADS, HUMAN_LIKE, driven_as, encounter_cells, meetings
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.statistics.density import Interval

_SELECTED = {event.title: name for name, event in EVENTS.items()}
_SELECTED |= {"95 %": "range", "gap": "gap", "after": "after"}
"""Columns of encounters that follow a selection, by their names in ``selection.js``."""

_PEOPLE = "P of a contact between people within 3 s: one of so many such moments ends in one"
_NAMED = 4  # futures of an event whose numbers are shown
_COLLISION = -1  # number of collisions among the metrics of a page


def event_table(run: Run, track_ids: Sequence[int], sides: Sequence[str]) -> dict[str, Any]:
    """Return the worst events by metric, the worst first; futures with the same event share a row.

    Returns:
        Rows have the index of the ``metric`` (-1: collision), ``futures``, the first ``future``, ``step``
        after the seed moment, and ``pair`` by index or None.
    """
    groups: dict[tuple[int, tuple[int, ...], int, float], list[int]] = {}
    index_of = {int(track): index for index, track in enumerate(track_ids)}
    number = {name: index for index, name in enumerate(run.columns)}

    def add(metric: int, event: Mapping[str, Any], step: int, value: float) -> None:
        vehicles = tuple(index_of[v] for v in (event["track_id"], event["other_id"]) if v in index_of)
        groups.setdefault((metric, vehicles, step, float(f"{value:.3g}")), []).append(event["future"])

    for event in run.worst.to_pylist():
        metric, step = number.get(event["metric"]), event["timestamp_ms"] // 100 - LOGGED_HISTORY
        if metric is not None and (np.isfinite(event["value"]) or sides[metric] == "right"):
            add(metric, event, step, event["value"])
    for event in run.collisions.to_pylist():
        add(_COLLISION, event, event["step"], event["relative_speed"])
    signs = [1 if side == "left" else -1 for side in sides] + [-1]  # the last sign: collisions
    order = sorted(groups.items(), key=lambda item: (item[0][0], signs[item[0][0]] * item[0][3], item[0][2]))
    columns = [
        {"title": "vehicles"},
        {"title": "value", "as": "real", "none": "∞"},
        {"title": "after", "as": "seconds"},
        {"title": "futures", "as": "times", "down": True},
        {"title": "which", "kind": "words"},
    ]
    return {"columns": columns, "rows": [_event(key, futures, track_ids) for key, futures in order]}


def _event(
    key: tuple[int, tuple[int, ...], int, float], futures: list[int], track_ids: Sequence[int]
) -> dict[str, Any]:
    metric, vehicles, step, value = key
    shown = ", ".join(str(future) for future in futures[:_NAMED]) + (", …" if len(futures) > _NAMED else "")
    names = " – ".join(str(track_ids[vehicle]) for vehicle in vehicles)
    return {
        "cells": [names, value, step * STEP_S, len(futures), shown],
        "metric": metric,
        "pair": vehicles if len(vehicles) == 2 else None,
        "future": futures[0],
        "futures": futures,
        "step": step,
    }


def pair_table(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Return the pairs of the answer, see `scex_sumo.reports.card`; ``first`` is the row that is shown first.

    Rows have a ``caption``, ``pair`` by index (without people), ``future`` on the page, and ``step``.
    """
    lines, decided = pair_lines(run), decided_line(run)
    if decided is not None and decided.pair not in [line.pair for line in lines]:
        lines.append(decided)
    index_of = {int(track): index for index, track in enumerate(track_ids)}
    hints = (_PEOPLE, f"Share of {run.futures} futures, driven as {driven_as(run)}, in which they collide")
    heads = [("pair", "names", "A vehicle hits or follows → another"), ("what happens", "words", "")]
    heads += [("people", "often", hints[0]), ("stress test", "percent", hints[1]), ("after", "seconds", "")]
    shown = [k for k in range(len(heads)) if run.reference is not None or heads[k][0] != "people"]
    # Where no human-like future shows a pair of people, that of the stress test does.
    met = {frozenset(meeting.pair): meeting.row["future"] for meeting in meetings(run)}
    rows: list[dict[str, Any]] = []
    for line in lines:
        is_human = line.people is not None and run.reference is not None
        future = line.future if line.people is None or is_human else met.get(frozenset(line.pair), 0)
        values: list[Any] = [line.label, line.how, line.people, line.stress, line.after_s]
        rows.append(
            {
                "cells": [values[k] for k in shown],
                "said": [line.cells[k] for k in shown],
                "caption": line.caption,
                "pair": [index_of[track] for track in line.pair if track in index_of],
                "human": is_human,
                "future": future + (run.futures if is_human else 0),
                "step": round(line.after_s / STEP_S),
            }
        )
    first = next((k for k, line in enumerate(lines) if decided and line.pair == decided.pair), 0)
    columns = table([heads[k] for k in shown], [row["cells"] for row in rows])["columns"]
    total = any_cells(run)
    return {"columns": columns, "rows": rows, "foot": [total[k] for k in shown], "first": first}


def encounter_table(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Return the encounters of both sets with ``words``, ``pair`` by index, ``future``, ``step``.

    Human-like futures follow those of the stress test: ``future`` counts both. ``pairs`` are all pairs by
    index, ``event`` of a row is its place among them. ``selected`` names what a column shows of selected
    futures.
    """
    encounters, index_of = meetings(run), {int(track): index for index, track in enumerate(track_ids)}
    both = any(meeting.futures == HUMAN_LIKE for meeting in encounters)
    wanted = {"pair", *_SELECTED} | ({"futures"} if both else set())
    places = [place for place, head in enumerate(HEADS) if head[0] in wanted]
    cells = [[encounter_cells(meeting)[place] for place in places] for meeting in encounters]
    columns = table([HEADS[place] for place in places], cells)["columns"]
    for place, column in zip(places, columns, strict=True):
        column |= {"selected": _SELECTED[name]} if (name := HEADS[place][0]) in _SELECTED else {}
    pairs: dict[tuple[int, int], int] = {}
    rows = []
    for meeting, mine in zip(encounters, cells, strict=True):
        encounter, is_human = meeting.row, meeting.futures == HUMAN_LIKE
        pair = index_of[encounter["track_id"]], index_of[encounter["other_id"]]
        rows.append(
            {
                "cells": [_short(cell) for cell in mine],
                "said": [cell.share if isinstance(cell, Interval) else None for cell in mine],
                "words": meeting.words(),
                "share": encounter["collision"],
                "critical": encounter["critical"] > 0,
                "pair": pair,
                "event": pairs.setdefault((min(pair), max(pair)), len(pairs)),
                "human": is_human,
                "future": encounter["future"] + (run.futures if is_human else 0),
                "step": round(encounter["time_s"] / STEP_S),
            }
        )
    return {"columns": columns, "rows": rows, "pairs": list(pairs)}


def _short(cell: Any) -> Any:
    """Return a cell of a page: numbers with five digits."""
    cell = cell.value if isinstance(cell, Interval) else cell
    if not isinstance(cell, float):
        return cell
    return float(f"{cell:.5g}") if np.isfinite(cell) else None
