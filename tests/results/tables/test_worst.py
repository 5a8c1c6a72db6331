"""Origins of the extrema of futures."""

from __future__ import annotations

import numpy as np

from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.results.tables.outcomes import worst_table
from tests.metrics.scenes import random_run


def test_worst_rows_of_futures() -> None:
    tracks, planned = random_run(np.random.default_rng(1), futures=3)
    values = evaluate(tracks, planned)
    ids, stamps = np.array([11, 12, 13, 14, 15]), np.arange(1, 11) * 100
    table = worst_table(values, futures=np.array([4, 5, 6]), track_ids=ids)
    names = ["future", "metric", "timestamp_ms", "track_id", "other_id", "value"]
    assert table.column_names == names
    rows = table.to_pylist()
    assert len(rows) == sum(int(w.defined.sum()) for w in values.worst.values())
    for entry in rows:
        future, worst = entry["future"] - 4, values.worst[entry["metric"]]
        assert entry["value"] == values.column(entry["metric"])[0][future]
        assert entry["timestamp_ms"] == stamps[worst.step[future]] > tracks.first * 100
        assert entry["track_id"] == ids[worst.vehicle[future]]
