"""Futures of a run as sumo-gui files: one future, an encounter, or several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.colors import Rgb, model_colors
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import writing
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import precedence_words, share_of
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.views.replay import write_view
from scex_sumo.world.drawings import FutureView


def write_future(run: Run, number: int) -> Path:
    """Write the view of one future, and return the file to open."""
    return _write(run, [_future_view(run, number)])


def write_first(run: Run) -> Path:
    """Write what to look at first, and return the file to open.

    It is the human-like future of the pair of the verdict, else the worst pair of the stress test, else a
    future.
    """
    decision, human = run.decision, run.reference
    if (
        decision is not None
        and human is not None
        and decision.pair is not None
        and decision.future is not None
    ):
        step = round((decision.time_s or 0.0) / STEP_S)
        words = (decision.how or decision.what or "").replace("; ", " · ")  # SUMO takes no semicolon
        return _write(human, [_event_view(human, decision.future, decision.pair, step, words)])
    met = [row for row in run.encounters.to_pylist() if row["critical"] > 0]
    if met:
        return write_encounter(run, met[0]["track_id"], met[0]["other_id"])
    return write_future(run, 0)


def _worst_row(run: Run, number: int, column: str) -> dict[str, Any]:
    here = np.asarray(run.worst["future"]) == number
    rows: list[dict[str, Any]] = run.worst.filter(pa.array(here)).to_pylist()
    return next((row for row in rows if row["metric"] == column), {})


def _tracks(row: dict[str, Any]) -> list[int]:
    return [row[name] for name in ("track_id", "other_id") if row.get(name) is not None]


def _named(run: Run, tracks: Sequence[int]) -> str:
    return " and ".join(str(run.name_of(track)) for track in tracks)


def write_worst(run: Run, column: str) -> Path:
    """Write the most critical future by a metric at its worst step, and return the file to open."""
    column = run.column(column)
    number = run.most_critical(column)
    row = _worst_row(run, number, column)
    if not row:
        return _write(run, [_future_view(run, number, title=_value(run, number, column))])
    return _write(run, [_event_view(run, number, _tracks(row), _step(row), _value(run, number, column))])


def write_encounter(run: Run, first: int, second: int) -> Path:
    """Write a typical future in which two vehicles meet, and return the file to open."""
    rows: list[dict[str, Any]] = run.encounters.to_pylist()
    row = next((row for row in rows if {row["track_id"], row["other_id"]} == {first, second}), None)
    if row is None:
        pairs = ", ".join(f"{row['track_id']},{row['other_id']}" for row in rows[:5]) or "none"
        raise ResultError(
            f"{run.folder}: {first} and {second} meet in no future; pairs that meet most often: {pairs}"
        )
    what, name = ("collides", COLLISION) if row["collision"] > 0 else ("critical", "critical")
    step, title = round(row["time_s"] / STEP_S), f"{what} in {share_of(row, name).share}"
    return _write(run, [_event_view(run, row["future"], [first, second], step, title)])


def write_grid(run: Run, count: int, column: str | None = None) -> Path:
    """Write futures side by side, and return the file to open.

    Args:
        column: most critical futures by this metric; None: most different futures.
    """
    if not 2 <= count <= run.futures:
        raise UsageError(f"--grid {count}: give 2 to {run.futures}, the number of futures")
    numbers = most_different(run, count) if column is None else most_critical(run, count, column)
    views = [_future_view(run, int(n), title=_value(run, int(n), column)) for n in numbers]
    return _write(run, views)


def most_different(run: Run, count: int) -> IntArray:
    """Return (count,) futures whose vehicles end in the most different places.

    Each is the farthest from those before it; the first is the farthest from the mean.
    """
    ends = [np.stack([block.x[:, :, -1], block.y[:, :, -1]], axis=-1) for block in run.state_blocks()]
    places = np.nan_to_num(np.concatenate(ends)).reshape(run.futures, -1)
    away = np.linalg.norm(places - places.mean(axis=0), axis=1)
    chosen: list[int] = []
    for number in range(count):
        chosen.append(int(np.argmax(away)))
        distance = np.linalg.norm(places - places[chosen[-1]], axis=1)
        away = distance if number == 0 else np.minimum(away, distance)
        away[chosen] = -1.0
    return np.array(chosen, dtype=np.int64)


def most_critical(run: Run, count: int, column: str) -> IntArray:
    """Return (count,) futures by a metric, the most critical first, undefined ones last."""
    column = run.column(column)
    values = run.values(column) * (1 if run.metric(column).side == "left" else -1)
    return np.argsort(values, kind="stable")[:count].astype(np.int64)


def _value(run: Run, number: int, column: str | None) -> str:
    """Return the extremum of a future in words: ``collision`` where its vehicles overlap."""
    if column is None:
        return ""
    row = _worst_row(run, number, column)
    if row and _overlap(run, row):
        return COLLISION
    metric, mean = run.metric(column), " mean" if column.endswith("_mean") else ""
    value = float(run.values(column)[number])
    return f"{metric.words}{mean} {value:.3g} {metric.column_unit or ''}".rstrip()


def _step(row: dict[str, Any]) -> int:
    return int(row["timestamp_ms"] // 100 - LOGGED_HISTORY)


def _overlap(run: Run, row: dict[str, Any]) -> bool:
    """Whether the two vehicles of an extremum have collided by then."""
    return any(
        hit["future"] == row["future"]
        and {hit["track_id"], hit["other_id"]} == {*_tracks(row)}
        and hit["step"] <= _step(row)
        for hit in run.collisions.to_pylist()
    )


def _future_view(run: Run, number: int, *, title: str = "", **event: Any) -> FutureView:
    states, models = run.states(number), run.models_of(number)
    return FutureView(number=number, states=states, models=models, title=title, past=LOGGED_HISTORY, **event)


def _event_view(run: Run, number: int, tracks: Sequence[int], step: int, what: str) -> FutureView:
    ids = list(run.info["seed_scene"]["track_ids"])
    stop = LOGGED_HISTORY - 1 + step  # the clock begins with the last second before the moment
    when = f"after {step * STEP_S:.1f} s (clock {(stop + 1) * STEP_S:.1f} s)"
    title = f"{what} · {_named(run, tracks)} {when}{precedence_words(run.info, tracks)}"
    event = [ids.index(track) for track in tracks if track in ids]  # people who are replayed have none
    return _future_view(run, number, title=title, event=event, stop=stop)


def colors_of(run: Run) -> dict[str, Rgb]:
    """Return the colour of each model, 0 to 255."""
    names = sorted(set(run.assignments["model"].unique().to_pylist()))
    return dict(zip(names, model_colors(names), strict=True))


def _write(run: Run, views: Sequence[FutureView]) -> Path:
    with writing(run.folder):
        return write_view(run.net.path.parent, run.net, run.scene, views, colors_of(run))
