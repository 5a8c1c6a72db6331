"""The design of a run, read back from its folder."""

from __future__ import annotations

import pyarrow as pa
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.results.design import intervals_of

INFO = {
    "seed_scene": {"track_ids": [4, 7]},
    "models": [{"model": "replay", "weight": 1.0}],
    "design": "random",
    "assign": {},
}


def test_an_assigned_model_that_the_run_does_not_have_is_one_line() -> None:
    assignments = pa.table({"model": ["replay", "x"]})
    with pytest.raises(ResultError, match="'x' is no model of this run"):
        intervals_of(INFO, assignments, futures=1)
