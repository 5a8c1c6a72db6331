"""Contents of a run's report: everything that its page shows, as words and arrays."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import ScexError
from scex_sumo.reports.page.packing import quantized, second_sums
from scex_sumo.reports.page.road_lines import road_paths
from scex_sumo.reports.page.run.curves import curve_arrays, curve_words, densities_of, effective_numbers
from scex_sumo.reports.page.run.metric_columns import metric_words
from scex_sumo.reports.page.run.tables import (
    collision_places,
    collision_share,
    encounter_table,
    event_table,
    metric_values,
)
from scex_sumo.reports.page.svg import ticks
from scex_sumo.reports.page.tracks import POSITION_M, UniqueTracks, unique_tracks, whole_tracks
from scex_sumo.reports.tables.runs import always_critical
from scex_sumo.reports.tables.under_test import verdict
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.statistics.density import BANDWIDTH
from scex_sumo.views.road_lines import road_lines
from scex_sumo.world.gui.colors import model_colors

FAR_M = 1e6
"""Where vehicles are that have left."""
_AROUND_M = 60.0


def report_contents(run: Run, scene: SeedScene | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the report of a run shows.

    Args:
        run: a finished run.
        scene: its seed scene, where it is at hand; else it is read from the folder.

    Returns:
        Words and single numbers, and arrays by name.
    """
    scene = scene or run.scene
    track_ids = [int(track) for track in run.info["seed_scene"]["track_ids"]]
    levels, models = _assignment(run, len(track_ids))
    metrics = [metric_words(run, column) for column in run.columns]
    curves = densities_of(run, run.columns)
    numbers = effective_numbers(run, [metric["side"] for metric in metrics])
    likely = None if run.reference is None else densities_of(run.reference, run.columns)
    for metric, number in zip(metrics, numbers, strict=True):
        metric |= {"numbers": number, **curve_words(curves, likely, metric["column"])}
    views = {metric["column"]: metric["view"] for metric in metrics}
    tracks = unique_tracks(run)
    arrays: dict[str, Any] = {
        "start": tracks.start,
        "motion": tracks.motion,
        "which": tracks.which,
        "levels": levels,
        "values": metric_values(run.metrics, run.columns),
        **curve_arrays(curves, "curve", views),
        **_recorded_arrays(scene, tracks.start, int(run.info["steps"])),
    }
    if run.reference is not None and likely is not None:
        arrays["likely"] = metric_values(run.reference.metrics, run.columns)
        arrays |= curve_arrays(likely, "likely", views)
    box = _box(tracks)
    left, right, low, high = box
    around = (left - _AROUND_M, right + _AROUND_M, low - _AROUND_M, high + _AROUND_M)
    seen = {"box": box, "road": road_paths(road_lines(_net(run), around))}
    return _words(run, scene, track_ids, models, metrics) | seen, arrays


def _words(
    run: Run, scene: SeedScene, track_ids: list[int], models: list[str], metrics: list[dict[str, Any]]
) -> dict[str, Any]:
    known = run.info["seed_scene"]
    command = run.info.get("command") or []
    return {
        "name": known["name"],
        "location": known.get("location", ""),
        "time_s": known.get("time_s"),
        "children": run.children,
        "steps": int(run.info["steps"]),
        "folder": str(run.folder),
        "command": shlex.join([str(word) for word in command]),
        "version": run.info.get("scex_sumo", ""),
        "seed": run.info.get("seed"),
        "design": run.info.get("design"),
        "under_test": sorted(int(track) for track in run.info.get("under_test") or {}),
        "notes": [*known.get("notes", []), *run.info.get("net_notes", []), *run.info.get("run_notes", [])],
        "track_ids": track_ids,
        "types": list(scene.types),
        "sizes": np.stack([scene.length, scene.width], axis=1).round(2).tolist(),
        "models": models,
        "colors": ["#{:02x}{:02x}{:02x}".format(*color) for color in model_colors(models)],
        "metrics": metrics,
        "ticks": [(value, f"{words} s") for value, words in ticks(0, int(run.info["steps"]) * STEP_S)],
        "bandwidth": BANDWIDTH,
        "collision": collision_share(run),
        "collisions": collision_places(run),
        "encounters": encounter_table(run, track_ids),
        "events": event_table(run, track_ids, [metric["side"] for metric in metrics]),
        "has_recorded": scene.future is not None and scene.future.shape[1] > 0,
        "likely_collisions": None if run.reference is None else collision_share(run.reference),
        "always": always_critical(run),
        "tested": verdict(run.under_test) if run.baseline is not None and run.info.get("under_test") else "",
    }


def _assignment(run: Run, vehicles: int) -> tuple[IntArray, list[str]]:
    """(C, V) who drove whom, and the models' names."""
    drove = run.assignments["model"].combine_chunks().dictionary_encode()
    return np.asarray(drove.indices, dtype=np.int64).reshape(-1, vehicles), drove.dictionary.to_pylist()


def _recorded_arrays(scene: SeedScene, start: IntArray, steps: int) -> dict[str, NDArray[Any]]:
    """The recorded future, and who else was there, as far as the children go; who has left is far away."""
    arrays: dict[str, NDArray[Any]] = {}
    if scene.future is not None and scene.future.shape[1]:
        valid = scene.future_valid
        there = np.ones(scene.future.shape, dtype=bool) if valid is None else valid
        arrays["recorded"] = whole_tracks(scene.future.map(lambda v: _steps(v, there, 0, steps)), start)
    others = scene.obstacles
    arrays["others"] = np.zeros((0, steps + 1, 2), dtype=np.int64)
    if others is not None:
        there, known = others.present, (others.states.x, others.states.y)
        places = [_steps(values, there, HISTORY_STEPS, HISTORY_STEPS + steps + 1) for values in known]
        arrays["others"] = quantized(np.stack(places, axis=-1), POSITION_M)
    return arrays


def _steps(values: FloatArray, there: BoolArray, first: int, stop: int) -> FloatArray:
    """(N, stop - first) of the values of each step; far away where nothing was recorded."""
    found: FloatArray = np.full((len(values), stop - first), FAR_M)
    part = np.where(there, values, FAR_M)[:, first:stop]
    found[:, : part.shape[1]] = part
    return found


def _box(tracks: UniqueTracks) -> tuple[float, float, float, float]:
    """Least and largest x, least and largest y of everything that moves, m."""
    owner = np.empty(len(tracks.motion), dtype=np.int64)
    owner[tracks.which] = np.arange(tracks.which.shape[1])
    moved = second_sums(tracks.motion[..., :2])
    centres = np.asarray((tracks.start[owner, None, :2] + moved) * POSITION_M)
    (left, low), (right, high) = centres.min(axis=(0, 1)).tolist(), centres.max(axis=(0, 1)).tolist()
    return left, right, low, high


def _net(run: Run) -> Any:
    try:
        return run.net.path
    except (ScexError, KeyError):  # a result without its net is shown without a road
        return run.folder / "none.net.xml"
