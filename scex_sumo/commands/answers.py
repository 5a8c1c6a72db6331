"""Answers of the commands as JSON; docs/json.md lists their keys."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.converters.datasets.moment import busiest
from scex_sumo.metrics.registry import critical_columns, metric_of, side_of
from scex_sumo.reports.encounter_rows import Meeting, meetings
from scex_sumo.reports.run_table import extra_rows
from scex_sumo.results.extras import extras_results
from scex_sumo.results.run import Run

if TYPE_CHECKING:
    from scex_sumo.converters.datasets.moment import Moment
    from scex_sumo.converters.datasets.recordings import LoadedRecording
    from scex_sumo.scene import SeedScene
    from scex_sumo.statistics.density import Interval


def run_answer(run: Run) -> dict[str, Any]:
    """Return the answer of ``run --json``."""
    scene, recorded = run.info["seed_scene"], run.info.get("recorded")
    return {
        "result": run.folder,
        **{name: path for name, path in {"report": None, **run.written}.items()},
        "scene": {key: scene.get(key) for key in ("name", "time_s", "vehicles", "track_ids")},
        "futures": run.children,
        "notes": [*scene.get("notes", ()), *run.info["net_notes"], *run.info["run_notes"]],
        "collision": {
            "recorded": None if recorded is None else len(recorded["overlaps"]),
            **_both(run, lambda one: one.collision.estimate if one.outcomes else None),
        },
        "metrics": [_metric(run, column) for column in critical_columns(run.columns)],
        "rows": extra_rows(run),
        "encounters": meeting_rows(meetings(run)),
        **{key: value for extra in extras_results() for key, value in extra.answer(run).items()},
    }


def meeting_rows(found: Sequence[Meeting]) -> list[dict[str, Any]]:
    """Return encounters as rows."""
    return [
        {"futures": one.futures, **one.row, "exact_collision": one.encounter.collision.exact} for one in found
    ]


def _both(run: Run, share: Any) -> dict[str, Any]:
    ones = {"stress_test": run, "human_like": run.reference}
    return {name: None if one is None else interval(share(one)) for name, one in ones.items()}


def _metric(run: Run, column: str) -> dict[str, Any]:
    metric, samples, limit = metric_of(column), run.samples(column), run.thresholds.get(column)
    return {
        "name": column,
        "unit": metric.unit,
        "critical": "at most" if side_of(column) == "left" else "at least",
        "threshold": limit,
        "recorded": run.recorded_value(column),
        "median": float(np.median(samples)) if len(samples) else None,
        "defined": len(samples),
        **_both(run, lambda one: None if limit is None else one.p_critical(column, threshold=limit)),
    }


def interval(share: Interval | None) -> dict[str, float] | None:
    """Return a share and its 95 % interval."""
    return None if share is None else {"value": share.value, "low": share.low, "high": share.high}


def inspect_answer(
    loaded: LoadedRecording, moments: list[Moment], scene: SeedScene | None, page: Path | None
) -> dict[str, Any]:
    """Return the answer of ``inspect --json``; ``scene`` is that of ``--time`` or ``--case``."""
    rows = loaded.table.vehicles
    return {
        "recording": loaded.recording.name,
        "page": page,
        "seconds": (int(rows.timestamp_ms.max()) - int(rows.timestamp_ms.min())) / 1000,
        "vehicles": len(set(rows.track_id.tolist())),
        "findings": loaded.findings,
        "notes": loaded.notes,
        "checks": [vars(check) for check in loaded.checks],
        "moments": [_moment(moment) for moment in moments],
        "busiest": _moment(busiest(moments)) if moments else None,
        "scene": None if scene is None else _scene(scene),
    }


def _moment(moment: Moment) -> dict[str, Any]:
    there = {"vehicles": moment.vehicles, "complete": moment.complete}
    return {"time_s": moment.time_s, "case": moment.case or None, **there}


def _scene(scene: SeedScene) -> dict[str, Any]:
    now = {"x": scene.now.x, "y": scene.now.y, "speed": scene.now.speed, "length": scene.length}
    ids, kinds = scene.track_ids.tolist(), scene.types
    columns = {"track_id": ids, "type": kinds, **{name: values.tolist() for name, values in now.items()}}
    each = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return {"name": scene.name, "time_s": scene.time_s, "vehicles": each}
