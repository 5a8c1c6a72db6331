"""Events of pairs: one table from which columns, words, bits and forecasts follow."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from scex_sumo.metrics.events import EVENTS

ONE_MORE = """
import dataclasses
from scex_sumo.metrics import events

near = events.Event(
    name="gap", value="gap", title="gap", measure="body gap", unit="m", threshold=0.5, critical="min",
    column="min_gap",
)
events.EVENTS = {**events.EVENTS, "gap": near}
events.MEASURED = (*events.MEASURED, near)

import numpy as np
from scex_sumo.metrics.events import EVENTS

from scex_sumo.reports.encounter_rows import HEADS
from scex_sumo.results.tables.encounters import QUESTIONS, encounters_table, event_of, outcomes_table
from scex_sumo.results.tables.encounters import BITS
from scex_sumo.studies.validate.vehicles import ENCOUNTERS
from tests.results.tables.test_encounters import LEVELS, MODELS, TRACKS, futures
from tests.metrics.scenes import find_encounters
from tests.statistics.shares import equal_shares

assert "gap" in EVENTS and QUESTIONS[-2:] == ("gap", "critical") and BITS["gap"] == 16
assert any(hint.startswith("body gap < 0.5 m") for _, _, hint in HEADS) and "gap_happened" in ENCOUNTERS.names

met = find_encounters(futures(LEVELS), None)
met = dataclasses.replace(met, kind=met.kind * 0 - 1, gap=met.gap * 0 + 0.2, ttc=np.full(len(met), np.inf))
design = equal_shares(LEVELS, "random")
(row,) = encounters_table(met, track_ids=TRACKS, models=MODELS[LEVELS], intervals=design).to_pylist()
assert row["critical"] == row["gap"] == len(met) / 40 and event_of(row) == ("gap", "gap < 0.5 m")
outcomes = outcomes_table(met, TRACKS)
assert outcomes["min_gap"].to_numpy().tolist() == [np.float32(0.2)] * len(met)
assert near.happens(outcomes["min_gap"].to_numpy()).all()
"""


def test_an_event_is_beyond_its_threshold_and_an_undefined_value_is_not() -> None:
    values = np.array([1.4, 1.5, 1.6, np.nan, np.inf])
    assert EVENTS["ttc"].happens(values).tolist() == [True, False, False, False, False]
    assert EVENTS["drac"].happens(values + 2).tolist() == [False, True, True, False, True]
    np.testing.assert_array_equal(EVENTS["ttc"].defined(values), [1.4, 1.5, 1.6, np.nan, np.nan])
    np.testing.assert_array_equal(EVENTS["drac"].defined(np.array([0.0, np.inf])), [np.nan, np.inf])


def test_one_entry_more_is_a_column_of_every_table() -> None:
    subprocess.run([sys.executable, "-c", ONE_MORE], check=True)
