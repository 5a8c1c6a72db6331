"""Contents of a run's report: everything that its page shows, as words and arrays."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.errors import ScexError
from scex_sumo.reports.page.metric_columns import metric_words
from scex_sumo.reports.page.packing import quantized, second_sums
from scex_sumo.reports.page.road_lines import UNIT_M, road_arrays
from scex_sumo.reports.page.tables import (
    collision_arrays,
    collision_share,
    encounter_table,
    event_table,
    likely_collisions,
    likely_values,
    metric_values,
)
from scex_sumo.reports.page.tracks import HEADING_RAD, POSITION_M, unique_tracks, whole_tracks
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, SeedScene
from scex_sumo.statistics.density import BANDWIDTH
from scex_sumo.world.colors import model_colors

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
    tracks = unique_tracks(run)
    arrays: dict[str, Any] = {
        "start": tracks.start,
        "motion": tracks.motion,
        "which": tracks.which,
        "levels": levels,
        "sizes": quantized(np.stack([scene.length, scene.width], axis=1), POSITION_M),
        "values": metric_values(run.metrics, run.columns),
        **collision_arrays(run),
        **_recorded_arrays(scene, tracks.start, int(run.info["steps"])),
        **road_arrays(_net(run), _box(tracks.start, tracks.motion)),
    }
    likely = likely_values(run, run.columns)
    if likely is not None:
        arrays["likely"] = likely
    return _words(run, scene, track_ids, models, metrics), arrays


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
        "quoted": shlex.quote(str(run.folder)),
        "version": run.info.get("scex_sumo", ""),
        "seed": run.info.get("seed"),
        "design": run.info.get("design"),
        "under_test": sorted(int(track) for track in run.info.get("under_test") or {}),
        "notes": [*known.get("notes", []), *run.info.get("net_notes", []), *run.info.get("run_notes", [])],
        "track_ids": track_ids,
        "types": list(scene.types),
        "models": models,
        "colors": ["#{:02x}{:02x}{:02x}".format(*color) for color in model_colors(models)],
        "metrics": metrics,
        "bandwidth": BANDWIDTH,
        "units": {"position": POSITION_M, "heading": HEADING_RAD, "road": UNIT_M},
        "collision": collision_share(run),
        "encounters": encounter_table(run, track_ids),
        "events": event_table(run, track_ids, [metric["side"] for metric in metrics]),
        "has_recorded": scene.future is not None and scene.future.shape[1] > 0,
        "likely_collisions": likely_collisions(run),
    }


def _assignment(run: Run, vehicles: int) -> tuple[IntArray, list[str]]:
    """(C, V) who drove whom, and the models' names."""
    drove = run.assignments["model"].combine_chunks().dictionary_encode()
    return np.asarray(drove.indices, dtype=np.int64).reshape(-1, vehicles), drove.dictionary.to_pylist()


def _recorded_arrays(scene: SeedScene, start: IntArray, steps: int) -> dict[str, NDArray[Any]]:
    """The recorded future as far as the children go, and who else was there."""
    arrays: dict[str, NDArray[Any]] = {}
    if scene.future is not None and scene.future.shape[1]:
        valid = scene.future_valid
        there = np.ones(scene.future.shape, dtype=bool) if valid is None else valid
        future = scene.future.map(lambda values: np.where(there, values, 0.0)[:, :steps])
        arrays["recorded"] = whole_tracks(future, start)
        arrays["recorded_valid"] = there[:, :steps].astype(np.int8)
    others = scene.obstacles
    if others is not None:
        part = slice(HISTORY_STEPS, HISTORY_STEPS + steps + 1)
        places = np.stack([others.states.x[:, part], others.states.y[:, part]], axis=-1)
        arrays["others"] = quantized(np.where(others.present[:, part, None], places, 0.0), POSITION_M)
        arrays["others_present"] = others.present[:, part].astype(np.int8)
    return arrays


def _box(start: IntArray, motion: IntArray) -> tuple[float, float, float, float]:
    """Around everything that moves, m."""
    reach: FloatArray = np.abs(second_sums(motion)[:, :, :2]).max(axis=(0, 1)) * POSITION_M + _AROUND_M
    low, high = start[:, :2].min(axis=0) * POSITION_M, start[:, :2].max(axis=0) * POSITION_M
    return low[0] - reach[0], high[0] + reach[0], low[1] - reach[1], high[1] + reach[1]


def _net(run: Run) -> Any:
    try:
        return run.net.path
    except (ScexError, KeyError):  # a result without its net is shown without a road
        return run.folder / "none.net.xml"
