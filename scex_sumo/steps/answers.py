"""Answers of the commands as JSON; docs/json.md lists their keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.metrics.registry import critical_columns
from scex_sumo.reports.encounter_rows import meetings, worst_stress
from scex_sumo.reports.words import extra_rows
from scex_sumo.results.run import Run
from scex_sumo.results.tables.pairs import PAIRS_FILE, any_of

if TYPE_CHECKING:
    from scex_sumo.statistics.density import Interval

LISTED: Final = 1e-9
"""P from which JSON has a pair."""


def run_answer(run: Run) -> dict[str, Any]:
    """Return the answer of ``run --json``."""
    scene, recorded = run.info["seed_scene"], run.info.get("recorded")
    return {
        "decision": None if run.decision is None else asdict(run.decision),
        "result": run.folder,
        **{name: path for name, path in {"report": None, **run.written}.items()},
        "scene": {key: scene.get(key) for key in ("name", "time_s", "vehicles", "track_ids")},
        "futures": run.futures,
        "notes": [*scene.get("notes", ()), *run.info["net_notes"], *run.info["run_notes"]],
        "collision": {
            "recorded": None if recorded is None else len(recorded["overlaps"]),
            **_both(run, lambda result: interval(result.collision)),
            "words": _both(run, lambda result: result.collision.percent),
        },
        "metrics": [_metric(run, column) for column in critical_columns(run.columns)],
        "rows": extra_rows(run),
        "stress_test": [
            {"pairs": [(meeting.row["track_id"], meeting.row["other_id"])], "words": meeting.words()}
            for meeting in worst_stress(run)
        ],
        "encounters": [meeting.named_row for meeting in meetings(run)],
        "human_like": _human_like(run),
    }


def _human_like(run: Run) -> dict[str, Any] | None:
    """Return the pairs for JSON, and P of a contact of any two without doubt; None without a reference."""
    if not (run.folder / PAIRS_FILE).is_file():
        return None
    rows = run.table(PAIRS_FILE).to_pylist()
    return {
        "futures": run.reference.futures if run.reference is not None else None,
        "any": any_of(row["probability"] for row in rows if not row["doubt"]),
        "pairs": [row for row in rows if row["probability"] >= LISTED],
    }


def _both(run: Run, value_of: Callable[[Run], Any]) -> dict[str, Any]:
    results = {"stress_test": run, "human_like": run.reference}
    return {name: None if result is None else value_of(result) for name, result in results.items()}


def _metric(run: Run, column: str) -> dict[str, Any]:
    metric, samples, limit = run.metric(column), run.samples(column), run.thresholds.get(column)

    def critical(result: Run) -> dict[str, float] | None:
        return None if limit is None else interval(result.p_critical(column, threshold=limit))

    return {
        "name": column,
        "unit": metric.unit,
        "critical": "at most" if metric.side == "left" else "at least",
        "threshold": limit,
        "recorded": run.recorded_value(column),
        "median": float(np.median(samples)) if len(samples) else None,
        "defined": len(samples),
        **_both(run, critical),
    }


def interval(share: Interval) -> dict[str, float]:
    """Return a share and its 95 % interval."""
    return {"value": share.value, "low": share.low, "high": share.high}
