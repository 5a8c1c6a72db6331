"""What is usual at each site of a validation: P of a collision, human-like, of the encounters there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.certainty.response.answer import any_of, once_in
from scex_sumo.certainty.response.usual import counts, usual_of
from scex_sumo.page.study import Column
from scex_sumo.studies.moments.encounters import SEVERITY
from scex_sumo.studies.moments.folder import MomentRef

HORIZON_S: Final = 3.0
"""Time after a moment in which others begin what they do."""
COLUMNS: Final = (
    Column("location", "site", "words"),
    Column(lambda row: row["kind"] or "off the lanes", "kind", "words"),
    Column("encounters", "encounters", "text", "Within 10 m, without doubtful data"),
    Column("to_test", "to test", "text", "What the decision of a run would test"),
    Column(lambda row: once_in(row["median"]), "people collide", "words", "Median of the encounters"),
    Column(lambda row: once_in(row["probability"]), "most", "words", "Human-like P of the worst one"),
    Column("worst", "worst", "words", "By severe injuries that are to be expected"),
    Column("place", "its place", "words", "By P, beside the median of the site and kind"),
)


def usual_rows(encounters: pa.Table) -> list[dict[str, Any]]:
    """Return one row for each site and kind of place, see `COLUMNS`, from rows of `ENCOUNTERS`."""
    classes: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in encounters.to_pylist():
        if counts(row):
            classes.setdefault((row["location"], row["kind"] or ""), []).append(row)
    return [_class_row(rows) for _, rows in sorted(classes.items())]


def _class_row(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    worst = max(rows, key=lambda row: (row[SEVERITY], row["probability"]))
    usual = usual_of(worst)
    assert usual is not None
    return {
        "location": worst["location"],
        "kind": worst["kind"],
        "encounters": len(rows),
        "to_test": sum(row["to_test"] for row in rows),
        "median": float(np.median([row["probability"] for row in rows])),
        "probability": max(row["probability"] for row in rows),
        "worst": f"{worst['other_id']} → {worst['person'] or worst['track_id']}, {worst['seed']}",
        "place": usual.words(worst["probability"]),
    }


def hourly(info: Mapping[str, Any]) -> str:
    """Return the expected collisions of a validation in words."""
    return f"people are expected to collide {info['collisions_an_hour']:.1g} times an hour, any contact"


def collisions_an_hour(pairs: Sequence[tuple[MomentRef, pa.Table]]) -> float:
    """Return the collisions an hour that people are expected to have, from the pairs of moments."""
    sure = (table.filter(pc.is_null(table["doubt"])) for _, table in pairs)
    either_of = [any_of(table["probability"].to_pylist()) for table in sure]
    return float(np.mean(either_of)) * 3600 / HORIZON_S
