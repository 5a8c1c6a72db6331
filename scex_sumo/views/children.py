"""Children of a run as files for plain sumo-gui: one, an encounter, or several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import IntArray
from scex_sumo.errors import ResultError, UsageError
from scex_sumo.files import write_atomic, writing
from scex_sumo.metrics.registry import metric_of, side_of
from scex_sumo.results.run import Run, open_run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.views.replay import ReadNet, write_view
from scex_sumo.world.gui.colors import Rgb, model_colors
from scex_sumo.world.gui.drawings import ChildView


def write_critical(run: Run) -> list[Path]:
    """Files for plain sumo-gui: the most critical child by each metric that is defined in any.

    A child that is so by several is shown at the worst step by the last of them.
    """
    files, net = [], ReadNet.of(run.net.path)
    columns = [c for c in run.columns if not c.endswith("_mean") and len(run.samples(c))]
    children = {column: run.most_critical(column) for column in columns}
    last = {number: column for column, number in children.items()}
    shown = {number: write_worst(run, column, net) for number, column in last.items()}
    for column, number in children.items():
        files.append(shown[number].with_name(f"critical_{column}.sumocfg"))
        write_atomic(files[-1], shown[number].read_bytes())
    return files


def write_critical_of(folder: Path) -> None:
    """The same for the run in a folder, for another process."""
    write_critical(open_run(folder))


def write_child(run: Run, number: int) -> Path:
    """Files that show one child in plain sumo-gui; returns the one to open."""
    return _write(run, [_child_view(run, number)])


def event_of(
    run: Run, number: int, *, critical: str | None = None, encounter: tuple[int, int] | None = None
) -> tuple[list[int], str]:
    """Who is to be looked at in a child, and why.

    Args:
        run: a finished run.
        number: of the child.
        critical: metric of which the child has an extremum.
        encounter: two vehicles of which the child is an encounter.

    Returns:
        Track ids, none for everybody, and words.
    """
    if encounter is not None:
        return list(encounter), _named(encounter)
    if critical is None:
        return [], ""
    row = _worst_row(run, number, run.column(critical))
    return _tracks(row), f"{_value(run, number, critical)} · {_named(_tracks(row))}".rstrip(" ·")


def _worst_row(run: Run, number: int, column: str) -> dict[str, Any]:
    """Where an extremum of a child comes from; empty for a mean, which has no step of its own."""
    here = np.asarray(run.worst["child"]) == number
    rows: list[dict[str, Any]] = run.worst.filter(pa.array(here)).to_pylist()
    return next((row for row in rows if row["metric"] == column), {})


def _tracks(row: dict[str, Any]) -> list[int]:
    return [row[name] for name in ("track_id", "other_id") if row.get(name) is not None]


def _named(tracks: Sequence[int]) -> str:
    return " and ".join(str(track) for track in tracks)


def write_worst(run: Run, column: str, net: ReadNet | None = None) -> Path:
    """Files that show the child most critical by a metric, at its worst step; returns the one to open.

    Args:
        run: a finished run.
        column: the metric.
        net: the run's, where it has been read for other children.
    """
    column = run.column(column)
    number = run.most_critical(column)
    row = _worst_row(run, number, column)
    if not row:
        return _write(run, [_child_view(run, number, title=_value(run, number, column))], net)
    tracks = _tracks(row)
    step = row["timestamp_ms"] // 100 - LOGGED_HISTORY
    return _write(run, [_event_view(run, number, tracks, step, _written(column, row["value"]))], net)


def write_encounter(run: Run, first: int, second: int) -> Path:
    """Files that show two vehicles in a typical child where they meet; returns the one to open.

    Raises:
        ResultError: they meet in no child.
    """
    rows: list[dict[str, Any]] = run.encounters.to_pylist()
    found = [row for row in rows if {row["track_id"], row["other_id"]} == {first, second}]
    if not found:
        pairs = ", ".join(f"{row['track_id']},{row['other_id']}" for row in rows[:5]) or "nobody"
        raise ResultError(f"{run.folder}: {first} and {second} meet in no child; those who do most: {pairs}")
    row = found[0]
    what = "collides in" if row["collision"] > 0 else "critical in"
    share = row["collision"] if row["collision"] > 0 else row["critical"]
    view = _event_view(
        run, row["child"], [first, second], round(row["time_s"] / STEP_S), f"{what} {100 * share:.0f} %"
    )
    return _write(run, [view])


def write_grid(run: Run, count: int, column: str | None = None) -> Path:
    """Files that show children side by side; returns the one to open.

    Args:
        run: a finished run.
        count: of children.
        column: shows the most critical ones by this metric; None shows those that differ most.

    Raises:
        UsageError: fewer than two children, or more than there are.
    """
    if not 2 <= count <= run.children:
        raise UsageError(f"--grid {count}: give 2 to {run.children}, the number of children")
    numbers = most_different(run, count) if column is None else most_critical(run, count, column)
    views = [_child_view(run, int(n), title=_value(run, int(n), column)) for n in numbers]
    return _write(run, views)


def most_different(run: Run, count: int) -> IntArray:
    """(count,) children whose vehicles end up in the most different places, the first ones most so.

    Each one is the farthest from those already chosen; the first is the farthest from the mean.
    """
    shape = run.children, -1, LOGGED_HISTORY + int(run.info["steps"])
    ends = np.stack([np.asarray(run.tracks[name]).reshape(shape)[:, :, -1] for name in ("x", "y")], axis=-1)
    places = ends.reshape(run.children, -1)
    away = np.linalg.norm(places - places.mean(axis=0), axis=1)
    chosen: list[int] = []
    for number in range(count):
        chosen.append(int(np.argmax(away)))
        distance = np.linalg.norm(places - places[chosen[-1]], axis=1)
        away = distance if number == 0 else np.minimum(away, distance)
        away[chosen] = -1.0
    return np.array(chosen, dtype=np.int64)


def most_critical(run: Run, count: int, column: str) -> IntArray:
    """(count,) children in the order of a metric, the most critical first; undefined ones last."""
    column = run.column(column)
    values = run.values(column) * (1 if side_of(column) == "left" else -1)
    return np.argsort(values, kind="stable")[:count].astype(np.int64)


def _value(run: Run, number: int, column: str | None) -> str:
    if column is None:
        return ""
    return _written(column, float(run.values(column)[number]))


def _written(column: str, value: float) -> str:
    """The value of a metric as the tables print it, with its unit."""
    metric, mean = metric_of(column), " mean" if column.endswith("_mean") else ""
    return f"{metric.words}{mean} {value:.3g} {metric.column_unit or ''}".rstrip()


def _child_view(run: Run, number: int, *, title: str = "", **event: Any) -> ChildView:
    return ChildView(
        number=number,
        states=run.states(number),
        models=run.models_of(number),
        title=title,
        past=LOGGED_HISTORY,
        **event,
    )


def _event_view(run: Run, number: int, tracks: Sequence[int], step: int, what: str) -> ChildView:
    """A child that stops at an event of some vehicles, ``step`` after the moment."""
    known = list(run.info["seed_scene"]["track_ids"])
    title = f"{what} · {_named(tracks)} after {step * STEP_S:.1f} s"
    return _child_view(
        run,
        number,
        title=title,
        event=[known.index(track) for track in tracks],
        stop=LOGGED_HISTORY - 1 + step,
    )


def colors_of(run: Run) -> dict[str, Rgb]:
    """The colour of each model of a run in sumo-gui and videos, 0 to 255."""
    names = sorted(set(run.assignments["model"].unique().to_pylist()))
    return dict(zip(names, model_colors(names), strict=True))


def _write(run: Run, views: Sequence[ChildView], net: ReadNet | None = None) -> Path:
    with writing(run.folder):
        return write_view(run.net.path.parent, run.net, run.scene, views, colors_of(run), again=net)
