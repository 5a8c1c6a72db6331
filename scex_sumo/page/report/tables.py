"""Tables of a report: encounters, collisions, worst events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.registry import COLLISION as COLLISION_COLUMN
from scex_sumo.page.report.encounter_table import HEADS, encounter_cells
from scex_sumo.page.study import table
from scex_sumo.reports.encounter_rows import (
    HUMAN_LIKE,
    Meeting,
    driven_as,
    first_look,
    grouped,
    meetings,
    probability_in,
    worst_of,
)
from scex_sumo.reports.run_table import expected_injuries
from scex_sumo.results.probability import critical_outcomes
from scex_sumo.results.run import PAIR_OUTCOMES, Run
from scex_sumo.results.tables.cut_sets import cut_set_words
from scex_sumo.results.tables.encounters import arrows, event_of, precedence_words
from scex_sumo.results.tables.outcomes import COLLISIONS, first_contacts
from scex_sumo.scene import LOGGED_HISTORY, STEP_S

_WORST = 3
BITS = {name: 1 << number for number, name in enumerate(EVENTS)}
"""Bit of each event in `pair_events`."""

_SELECTED = {event.title: name for name, event in EVENTS.items()}
_SELECTED |= {"95 %": "range", "gap": "gap", "after": "after"}
"""Columns of encounters that follow a selection, by their names in ``selection.js``."""

_NAMED = 4  # futures of an event whose numbers are shown
_COLLISION = -1  # number of collisions among the metrics of a page


def event_table(run: Run, track_ids: Sequence[int], sides: Sequence[str]) -> dict[str, Any]:
    """Return the worst events by metric, the worst first; futures with the same event share a row.

    Returns:
        Rows have the index of the ``metric`` (-1: collision), ``futures``, the first ``future``, ``step``
        after the seed moment, and ``pair`` by index or None.
    """
    groups: dict[tuple[int, tuple[int, ...], int, float], list[int]] = {}
    where = {int(track): index for index, track in enumerate(track_ids)}
    number = {name: index for index, name in enumerate(run.columns)}

    def add(metric: int, row: Mapping[str, Any], step: int, value: float) -> None:
        vehicles = tuple(where[v] for v in (row["track_id"], row["other_id"]) if v in where)
        groups.setdefault((metric, vehicles, step, float(f"{value:.3g}")), []).append(row["future"])

    for row in _rows(run, "worst.parquet"):
        if row["metric"] in number:
            step = row["timestamp_ms"] // 100 - LOGGED_HISTORY
            if np.isfinite(row["value"]) or sides[number[row["metric"]]] == "right":
                add(number[row["metric"]], row, step, row["value"])
    for row in _rows(run, COLLISIONS):
        add(_COLLISION, row, row["step"], row["relative_speed"])
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
    which = ", ".join(str(future) for future in futures[:_NAMED]) + (", …" if len(futures) > _NAMED else "")
    names = " – ".join(str(track_ids[vehicle]) for vehicle in vehicles)
    return {
        "cells": [names, value, step * STEP_S, len(futures), which],
        "metric": metric,
        "pair": vehicles if len(vehicles) == 2 else None,
        "future": futures[0],
        "futures": futures,
        "step": step,
    }


def collision_places(both: Sequence[Run], track_ids: Sequence[int]) -> dict[str, Any]:
    """Return ``futures``, ``places`` (m) and ``pairs`` by index of collisions, by set of futures."""
    where = {int(track): index for index, track in enumerate(track_ids)}
    collisions: dict[str, Any] = {"futures": [], "places": [], "pairs": []}
    first = 0
    for run in both:
        for row in _rows(run, COLLISIONS):
            collisions["futures"].append(first + row["future"])
            collisions["places"].append((round(row["x"], 2), round(row["y"], 2)))
            collisions["pairs"].append((where[row["track_id"]], where[row["other_id"]]))
        first += run.futures
    return collisions


def pair_events(both: Sequence[Run], pairs: Sequence[tuple[int, int]], track_ids: Sequence[int]) -> IntArray:
    """Return (P, C) what happens to pairs of vehicles in the futures of all sets.

    Bits: those of `BITS`; a collision has all.
    """
    number = np.full((len(track_ids), len(track_ids)), -1)
    for index, (one, other) in enumerate(pairs):
        number[[one, other], [other, one]] = index
    where = {int(track): index for index, track in enumerate(track_ids)}
    parts = [np.zeros((len(pairs), run.futures), dtype=np.int64) for run in both]
    for run, events in zip(both, parts, strict=True):
        if not len(pairs):
            continue
        hits = first_contacts(run.collisions)
        tables = [(hits, ("track_id", "other_id"), np.full(hits.num_rows, sum(BITS.values())))]
        if (run.folder / PAIR_OUTCOMES).is_file():
            met = run.pair_outcomes
            critical = critical_outcomes(met)
            bits = np.sum([BITS[name] * happens for name, happens in critical.items()], axis=0)
            tables.append((met, ("track_a", "track_b"), bits))
        for rows, names, values in tables:
            at = number[tuple([where[t] for t in rows[name].to_pylist()] for name in names)]
            events[at[at >= 0], np.asarray(rows["future"])[at >= 0]] |= values[at >= 0]
    return np.concatenate(parts, axis=1)


def collision_share(run: Run) -> dict[str, Any] | None:
    """Return how many futures collide, P, its 95 % interval and how they are driven, in words; or None."""
    if COLLISION_COLUMN not in run.metrics.column_names:
        return None
    share, count = run.collision, int(np.asarray(run.metrics[COLLISION_COLUMN]).sum())
    return {
        "count": count,
        "futures": run.futures,
        "injuries": expected_injuries(run),
        "driven": f"driven as {driven_as(run)}",
        "percent": share.share,
        "range": f"{share.range} %",
    }


def encounter_table(run: Run, track_ids: Sequence[int]) -> dict[str, Any]:
    """Return the encounters of both sets with ``words``, ``pair`` by index, ``future``, ``step``, ``worst``.

    Human-like futures follow those of the stress test: ``future`` counts both. ``pairs`` are all pairs by
    index, ``event`` of a row is its place among them, ``first`` the row that is shown at first. ``selected``
    names what a column shows of selected futures.
    """
    encounters, where = meetings(run), {int(track): index for index, track in enumerate(track_ids)}
    both = any(one.futures == HUMAN_LIKE for one in encounters)
    sets = [run] if run.reference is None else [run, run.reference]
    wanted = {"pair", *_SELECTED} | ({"futures"} if both else set())
    places = [place for place, head in enumerate(HEADS) if head[0] in wanted]
    both_of = [[[part[place] for place in places] for part in encounter_cells(one)] for one in encounters]
    cells = [cells for cells, _ in both_of]
    columns = table([HEADS[place] for place in places], cells)["columns"]
    for place, column in zip(places, columns, strict=True):
        column |= {"selected": _SELECTED[name]} if (name := HEADS[place][0]) in _SELECTED else {}
    pairs: dict[tuple[int, int], int] = {}
    rows = []
    kept = worst_of(encounters)
    groups = {id(group[0]): group for group in grouped(kept)[:_WORST]}
    for one, (mine, said) in zip(encounters, both_of, strict=True):
        row, is_human = one.row, one.futures == HUMAN_LIKE
        pair = where[row["track_id"]], where[row["other_id"]]
        rows.append(
            {
                "cells": [_short(cell) if isinstance(cell, float) else cell for cell in mine],
                "said": said,
                "words": one.words(),
                "share": row["collision"],
                "critical": row["critical"] > 0,
                "pair": pair,
                "event": pairs.setdefault((min(pair), max(pair)), len(pairs)),
                "human": is_human,
                "future": row["future"] + (run.futures if is_human else 0),
                "step": round(row["time_s"] / STEP_S),
                "worst": id(one) in groups,
                **(_story(groups[id(one)], sets) if id(one) in groups else {}),
            }
        )
    known = (run.folder / PAIR_OUTCOMES).is_file()  # not in results of older versions
    look = first_look(run, encounters)
    first = 0 if look is None else encounters.index(look)
    return {"columns": columns, "rows": rows, "pairs": list(pairs), "known": known, "first": first}


def _story(group: Sequence[Meeting], both: Sequence[Run]) -> dict[str, Any]:
    """Return what happens in a worst encounter: question, words, kind, place, pairs alike, drivers.

    ``told`` are P and its interval in words: of the stress test, then of human-like futures.
    """
    one, more = group[0], [(like.row["track_id"], like.row["other_id"]) for like in group[1:]]
    question, happens = event_of(one.row)
    also = [f"so {len(more)} more: {arrows(more)}"] if more else []
    tracks = [one.row["track_id"], one.row["other_id"]]
    drivers = [
        f"{track} {one.row[model]}" for track, model in zip(tracks, ("model", "other_model"), strict=True)
    ]
    always = cut_set_words(one.row.get("cut_sets") or ())
    why = always[0] if always else f"typically {', '.join(drivers)}"
    shares = [probability_in(run, one.pair, question) for run in both]
    return {
        "question": question,
        "happens": happens,
        "about": ", ".join(part for part in (one.row["kind"], one.row["place"], *also) if part),
        "why": why + precedence_words(one.run.info, one.pair),
        "told": [(share.share, f"{share.range} %") for share in shares],
    }


def metric_values(table: pa.Table, columns: Sequence[str]) -> FloatArray:
    """Return (M, C) columns of a table, NaN where undefined or missing."""
    missing = np.full(table.num_rows, np.nan)
    parts = [
        table[name].to_numpy(zero_copy_only=False) if name in table.column_names else missing
        for name in columns
    ]
    return np.stack([np.asarray(part, dtype=np.float64) for part in parts])


def _rows(run: Run, name: str) -> list[dict[str, Any]]:
    return list(run.table(name).to_pylist()) if (run.folder / name).is_file() else []


def _short(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.5g}")
