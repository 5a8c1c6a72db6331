"""Contents of a run's report: names, numbers and arrays for its scripts."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.colors import model_colors
from scex_sumo.base.errors import ScexError
from scex_sumo.reports.page.charts import ticks
from scex_sumo.reports.page.metrics import (
    curve_arrays,
    curve_words,
    densities_of,
    effective_numbers,
    metric_words,
)
from scex_sumo.reports.page.packing import quantized
from scex_sumo.reports.page.scene import POSITION_M, recorded_tracks, road_paths, unique_tracks
from scex_sumo.reports.page.tables import (
    collision_places,
    collision_share,
    encounter_table,
    event_table,
    metric_values,
)
from scex_sumo.reports.run_table import always_critical, human_above
from scex_sumo.reports.under_test_table import verdict
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.statistics.density import BANDWIDTH
from scex_sumo.views.road_lines import road_lines

FAR_M = 1e6  # place of vehicles that have left
_AROUND_M = 60.0


def report_contents(run: Run, scene: SeedScene | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return names and single numbers of a report, and arrays by name.

    ``scene`` is the seed scene; None reads it from the folder.
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
    left, right, low, high = tracks.box
    around = (left - _AROUND_M, right + _AROUND_M, low - _AROUND_M, high + _AROUND_M)
    place = {"box": tracks.box, "road": road_paths(road_lines(_net(run), around))}
    return _words(run, scene, track_ids, models, metrics) | place, arrays


def _words(
    run: Run, scene: SeedScene, track_ids: list[int], models: list[str], metrics: list[dict[str, Any]]
) -> dict[str, Any]:
    scene_info = run.info["seed_scene"]
    command = run.info.get("command") or []
    return {
        "name": scene_info["name"],
        "location": scene_info.get("location", ""),
        "time_s": scene_info.get("time_s"),
        "children": run.children,
        "steps": int(run.info["steps"]),
        "folder": str(run.folder),
        "command": shlex.join([str(word) for word in command]),
        "version": run.info.get("scex_sumo", ""),
        "seed": run.info.get("seed"),
        "design": run.info.get("design"),
        "under_test": sorted(int(track) for track in run.info.get("under_test") or {}),
        "notes": [
            *scene_info.get("notes", []),
            *run.info.get("net_notes", []),
            *run.info.get("run_notes", []),
        ],
        "track_ids": track_ids,
        "types": list(scene.types),
        "sizes": np.stack([scene.length, scene.width], axis=1).round(2).tolist(),
        "models": models,
        "colors": ["#{:02x}{:02x}{:02x}".format(*color) for color in model_colors(models)],
        "metrics": metrics,
        "ticks": [(value, f"{words} s") for value, words in ticks(0, int(run.info["steps"]) * STEP_S)],
        "bandwidth": BANDWIDTH,
        "collision": collision_share(run),
        "collisions": collision_places(run, track_ids),
        "encounters": encounter_table(run, track_ids),
        "events": event_table(run, track_ids, [metric["side"] for metric in metrics]),
        "has_recorded": scene.future is not None and scene.future.shape[1] > 0,
        "likely_collisions": None if run.reference is None else collision_share(run.reference),
        "always": always_critical(run),
        "above": human_above(run),
        "tested": verdict(run.under_test) if run.baseline is not None and run.info.get("under_test") else "",
    }


def _assignment(run: Run, vehicles: int) -> tuple[IntArray, list[str]]:
    coded = run.assignments["model"].combine_chunks().dictionary_encode()
    return np.asarray(coded.indices, dtype=np.int64).reshape(-1, vehicles), coded.dictionary.to_pylist()


def _recorded_arrays(scene: SeedScene, start: IntArray, steps: int) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    if scene.future is not None and scene.future.shape[1]:
        valid = scene.future_valid
        there = np.ones(scene.future.shape, dtype=bool) if valid is None else valid
        arrays["recorded"] = recorded_tracks(scene.future.map(lambda v: _steps(v, there, 0, steps)), start)
    others = scene.obstacles
    arrays["others"] = np.zeros((0, steps + 1, 2), dtype=np.int64)
    if others is not None:
        first, stop = HISTORY_STEPS, HISTORY_STEPS + steps + 1
        places = [_steps(v, others.present, first, stop) for v in (others.states.x, others.states.y)]
        arrays["others"] = quantized(np.stack(places, axis=-1), POSITION_M)
    return arrays


def _steps(values: FloatArray, there: BoolArray, first: int, stop: int) -> FloatArray:
    """Return (N, stop - first) values, far away where nothing was recorded."""
    padded: FloatArray = np.full((len(values), stop - first), FAR_M)
    part = np.where(there, values, FAR_M)[:, first:stop]
    padded[:, : part.shape[1]] = part
    return padded


def _net(run: Run) -> Any:
    try:
        return run.net.path
    except (ScexError, KeyError):  # no net: a report without a road
        return run.folder / "none.net.xml"
