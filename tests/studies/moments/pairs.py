"""Pairs of moments as workers give them, made by hand."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.moments.pairs import PAIRS


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
    """Pairs of a moment, one severe injury in ten collisions; without any, vehicles 1 and 2."""
    row = {
        "action": "brakes",
        "value": 5.0,
        "frequency": 1e-3,
        "response_s": 1.1,
        "later": 0.1,
        "factor": 4.0,
        "delta_v": 5.0,
        "kind": "merge",
        "takes": "it brakes",
        "contact_s": 2.0,
        "to_test": True,
        "preventable": True,
        "gap_m": 3.0,
        "probability": probability,
        "probability_hard": probability / 2,
        "severity": probability / 10,
    }
    rows = [row | {"track_id": one, "other_id": other} | values for one, other in pairs or [(1, 2)]]
    return pa.Table.from_pylist(rows, schema=PAIRS)
