"""Contents of a run's report: names, numbers, metrics and arrays for its scripts."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.colors import model_colors
from scex_sumo.converters.net.reading import road_lines
from scex_sumo.metrics.events import MEASURED
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.page.figures.axes import samples_of_both, ticks, value_range
from scex_sumo.page.packing import UNITS, coded_motion, quantized
from scex_sumo.page.report.scene import FAR_M, Future, packed_tracks, poses_of, road_paths
from scex_sumo.page.report.tables import encounter_table, event_table, pair_table
from scex_sumo.reports.words import extra_rows
from scex_sumo.results.design import half_widths
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import BITS, pair_events
from scex_sumo.rules.lights import light_bars
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.statistics.density import BANDWIDTH, split_atoms

SUMO_FILES = ".sumocfg", ".net.xml", ".net.xml.gz"  # of maps whose lights have phases
_AROUND_M = 60.0
_WORST_SHARE = 0.1


def report_contents(run: Run, scene: SeedScene | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return names and single numbers of a report, and arrays by name; None reads the folder's scene."""
    scene = scene or run.scene
    track_ids = [int(track) for track in run.info["seed_scene"]["track_ids"]]
    both = [run] if run.reference is None else [run, run.reference]
    coded = pa.concat_tables([result.assignments.select(["model"]) for result in both])["model"]
    coded = coded.combine_chunks().dictionary_encode()
    levels = np.asarray(coded.indices, dtype=np.int64).reshape(-1, len(track_ids))
    models = coded.dictionary.to_pylist()
    bands = half_widths(run.metrics, run.columns, run.intervals)
    metrics = [metric_words(run, column) | {"band": bands[column]} for column in run.columns]
    info = _words(run, scene, track_ids, models, metrics)
    pairs = [(track_ids[a], track_ids[b]) for a, b in info["encounters"]["pairs"]]
    tracks = packed_tracks(_futures(both, info))
    arrays: dict[str, Any] = {
        "start": tracks.start,
        "motion": tracks.motion,
        "owner": tracks.owner,
        "which": tracks.which,
        "levels": levels,
        "values": np.array([np.concatenate([result.values(c) for result in both]) for c in run.columns]),
        "events": np.concatenate([pair_events(result, pairs) for result in both], axis=1),
        **_recorded_arrays(scene, tracks.start, int(run.info["steps"])),
    }
    left, right, low, high = tracks.box
    around = (left - _AROUND_M, right + _AROUND_M, low - _AROUND_M, high + _AROUND_M)
    place = {"box": tracks.box, "road": road_paths(road_lines(run.net.path, around)), "lights": _lights(run)}
    return info | place | {"packed": tracks.futures.tolist()}, arrays


def _futures(both: list[Run], info: dict[str, Any]) -> list[Future]:
    """Return the futures, those of table rows first; human-like ones only if a row shows them."""
    rows = [row["future"] for name in ("pairs", "encounters", "events") for row in info[name]["rows"]]
    numbers = dict.fromkeys([*rows, *range(both[0].futures)])
    known = [(run, future) for run in both for future in range(run.futures)]
    return [(*known[number], number) for number in numbers]


def _words(
    run: Run, scene: SeedScene, track_ids: list[int], models: list[str], metrics: list[dict[str, Any]]
) -> dict[str, Any]:
    scene_info, human = run.info["seed_scene"], run.reference
    command = run.info.get("command") or []
    notes = [*scene_info.get("notes", ()), *run.info.get("net_notes", ()), *run.info.get("run_notes", ())]
    collided = np.concatenate([result.values(COLLISION) for result in (run, human) if result is not None])
    return {
        "name": scene_info["name"],
        "time_s": scene_info.get("time_s"),
        "futures": run.futures,
        "human": 0 if human is None else human.futures,
        "steps": int(run.info["steps"]),
        "folder": str(run.folder),
        "command": shlex.join([str(word) for word in command]),
        "version": run.info.get("scex_sumo", ""),
        "under_test": [run.name_of(t) for t in sorted(map(int, run.info.get("under_test") or {}))],
        "notes": notes,
        "track_ids": [run.name_of(track) for track in track_ids],
        "types": list(scene.types),
        "sizes": np.stack([scene.length, scene.width], axis=1).round(2).tolist(),
        "models": models,
        "colors": ["#{:02x}{:02x}{:02x}".format(*color) for color in model_colors(models)],
        "metrics": metrics,
        "ticks": [(value, f"{words} s") for value, words in ticks(0, int(run.info["steps"]) * STEP_S)],
        "bandwidth": BANDWIDTH,
        "collided": np.flatnonzero(collided).tolist(),
        "pairs": pair_table(run, track_ids),
        "encounters": encounter_table(run, track_ids),
        "bits": BITS,
        "limits": {event.name: event.threshold for event in MEASURED},
        "events": event_table(run, track_ids, [metric["side"] for metric in metrics]),
        "has_recorded": scene.future is not None and scene.future.shape[1] > 0,
        "rows": extra_rows(run),
    }


def _recorded_arrays(scene: SeedScene, start: IntArray, steps: int) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    if scene.future is not None and scene.future.shape[1]:
        valid = scene.future_valid
        there = np.ones(scene.future.shape, dtype=bool) if valid is None else valid
        future = scene.future.map(lambda v: _steps(v, there, 0, steps))
        arrays["recorded"] = coded_motion(start, poses_of(future))
    others = scene.obstacles
    arrays["others"] = np.zeros((0, steps + 1, 2), dtype=np.int64)
    if others is not None:
        first, stop = HISTORY_STEPS, HISTORY_STEPS + steps + 1
        places = [_steps(v, others.present, first, stop) for v in (others.states.x, others.states.y)]
        arrays["others"] = quantized(np.stack(places, axis=-1), UNITS[0])
    return arrays


def _steps(values: FloatArray, there: BoolArray, first: int, stop: int) -> FloatArray:
    """Return (N, stop - first) values, far away where nothing was recorded."""
    padded: FloatArray = np.full((len(values), stop - first), FAR_M)
    recorded = np.where(there, values, FAR_M)[:, first:stop]
    padded[:, : recorded.shape[1]] = recorded
    return padded


def _lights(run: Run) -> list[tuple[list[list[float]], str]]:
    """Return ends of the bars of lights, m, and the letters of all steps; none where lights are unknown."""
    known = str(run.info["seed_scene"].get("map", "")).endswith(SUMO_FILES)
    bars = light_bars(run.net.path, int(run.info["steps"]), known=known)
    return [(bar.ends.round(2).tolist(), bar.letters) for bar in bars]


def metric_words(run: Run, column: str) -> dict[str, Any]:
    """Return name, unit, side, thresholds, range, number of values and frequent values of a metric column."""
    metric = run.metric(column)
    recorded, threshold = run.recorded_value(column), run.thresholds.get(column)
    side, tenth = metric.side, _WORST_SHARE if metric.side == "left" else 1 - _WORST_SHARE
    samples = np.sort(run.samples(column))
    view = value_range(samples_of_both(run, column), recorded, threshold)
    share = run.p_critical(column) if threshold is not None and samples.size else None
    return {
        "column": column,
        "name": metric.words,
        "unit": metric.column_unit,
        "mean": column.endswith("_mean"),
        "side": side,
        "sign": metric.sign,
        "threshold": threshold,
        "p": None if share is None else {"value": share.value, "low": share.low, "high": share.high},
        "tenth": float(np.quantile(samples, tenth, method="inverted_cdf")) if samples.size else None,
        "recorded": recorded,
        "defined": int(samples.size),
        "atoms": _atoms(run, column),
        "likely_atoms": [] if run.reference is None else _atoms(run.reference, column),
        "view": view,
        "ticks": ticks(*view) if np.isfinite(samples).any() else [],
    }


def _atoms(run: Run, column: str) -> list[float]:
    samples = run.samples(column)
    return [atom.value for atom in split_atoms(samples)[0]] if samples.size else []
