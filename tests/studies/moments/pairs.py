"""Pairs of moments as workers give them, made by hand."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from scex_sumo.studies.moments.encounters import PAIRS
from scex_sumo.studies.moments.folder import MomentRef


def moment(
    time_s: float, *tables: pa.Table, recording: str = "r", case: str = ""
) -> tuple[MomentRef, pa.Table]:
    name = f"{recording}_{case}_{time_s}"
    ref = MomentRef(moment=name, location="here", recording=recording, case=case, time_s=time_s, vehicles=3)
    return ref, pa.concat_tables(tables)


def moment_ref(name: str, location: str = "here", time_s: float = 1.0) -> MomentRef:
    return MomentRef(
        moment=name, location=location, recording="recording", case="", time_s=time_s, vehicles=3
    )


def pairs_table(*pairs: tuple[int, int], probability: float = 1e-4, **values: Any) -> pa.Table:
    """Pairs of a moment; without any, vehicles 1 and 2."""
    row = {
        "probability": probability,
        "least": probability / 10,
        "most": min(10 * probability, 1.0),
        "what": "merging",
        "how": "2 merges; 1 needs 2.0 m/s²",
        "place": "merge",
        "future": 3,
        "futures": 5,
        "collide": 0.0,
        "needed_braking": 2.0,
        "time_margin": None,
        "gap_m": 3.0,
        "conflict_s": 2.0,
        "speed_mps": 4.0,
        "to_test": probability >= 1e-4,
    }
    rows = [row | {"track_id": one, "other_id": other} | values for one, other in pairs or [(1, 2)]]
    return pa.Table.from_pylist(rows, schema=PAIRS)
