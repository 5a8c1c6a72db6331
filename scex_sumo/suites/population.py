"""Population of a catalogue: the encounters of rankings, one candidate for each vehicle that may be tested.

In a candidate the function drives the vehicle that hits or follows. Where the other one is a vehicle that
could respond, too, the same encounter with the roles exchanged is a second candidate, and each stands for
half of it. Encounters with doubtful data, and those in which a contact is rarer than once in a million, are
left out and counted; a kind that has only such rare ones keeps them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError, one_line
from scex_sumo.decision.typology import CONFLICTS, LEADING

RARE: Final = 1e-6
"""P of a contact below which an encounter is a candidate only where its kind has no other."""
_COLUMNS: Final = (
    *("location", "recording", "case", "seed", "time_s", "track_id", "other_id", "person"),
    *("probability", "conflict", "doubt"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """Candidates of a data set.

    Attributes:
        rows: one for each; the function drives ``track_id``; ``share`` is that of an encounter.
        hours: recorded time.
        encounters: of which these are candidates.
        rare: encounters left out, of kinds that have others; ``doubtful`` those with doubtful data.
        roots: of the recordings.
        moments: number of them.
    """

    rows: Sequence[Mapping[str, Any]]
    hours: float
    encounters: int
    rare: int
    doubtful: int
    roots: Sequence[str]
    moments: int

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> FloatArray:
        """Return the (N,) values of a column."""
        return np.array([candidate[name] for candidate in self.rows], dtype=np.float64)

    @property
    def kind(self) -> IntArray:
        """Kind of each candidate (N,), an index into `CONFLICTS`."""
        return np.array([CONFLICTS.index(candidate["conflict"]) for candidate in self.rows], dtype=np.int64)

    def exposure(self) -> list[dict[str, Any]]:
        """Return by kind the encounters, people's contacts an hour, and the number of candidates."""
        kind, share = self.kind, self.column("share")
        contacts = share * self.column("probability") / self.hours
        return [
            {
                "kind": CONFLICTS[k],
                "encounters": float(share[kind == k].sum()),
                "people_collide_per_hour": float(contacts[kind == k].sum()),
                "candidates": int((kind == k).sum()),
            }
            for k in np.unique(kind).tolist()
        ]


def read_population(folders: Sequence[Path]) -> Population:
    """Read the candidates of finished rankings.

    Raises:
        UsageError: one cannot be read, is of an older version, or none has an encounter.
    """
    encounters: list[Mapping[str, Any]] = []
    roots, hours, doubtful, moments = [], 0.0, 0, 0
    for folder in folders:
        info, table, times = _read(folder)
        roots += [root for root in info["roots"] if root not in roots]
        hours += recorded_hours(times, float(info["every_s"]))
        moments += int(info["seeds"])
        sure = table.filter(pc.is_null(table["doubt"]))
        doubtful += len(table) - len(sure)
        encounters += sure.to_pylist()
    frequent = {encounter["conflict"] for encounter in encounters if encounter["probability"] >= RARE}
    kept = [
        encounter
        for encounter in encounters
        if encounter["conflict"]
        and (encounter["probability"] >= RARE or encounter["conflict"] not in frequent)
    ]
    if not kept:
        raise UsageError(
            f"{', '.join(map(str, folders))}: no encounter without doubt; nothing to choose from"
        )
    return Population(
        rows=[candidate for encounter in kept for candidate in candidates_of(encounter)],
        hours=hours,
        encounters=len(kept),
        rare=len(encounters) - len(kept),
        doubtful=doubtful,
        roots=roots,
        moments=moments,
    )


def candidates_of(encounter: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the one or two candidates of an encounter; a leader and a person do not respond."""
    if encounter["person"] is not None or encounter["conflict"] in LEADING:
        return [{**encounter, "share": 1.0}]
    exchanged = {"track_id": encounter["other_id"], "other_id": encounter["track_id"]}
    return [{**encounter, "share": 0.5}, {**encounter, **exchanged, "share": 0.5}]


def _read(folder: Path) -> tuple[dict[str, Any], pa.Table, pa.Table]:
    try:
        info = json.loads((folder / "rank.json").read_bytes())
        table = pq.read_table((folder / "ranking.parquet").absolute())
        moments = pq.read_table((folder / "moments.parquet").absolute())
        missing = [name for name in _COLUMNS if name not in table.column_names]
        if missing or "roots" not in info:
            lacks = missing[0] if missing else "roots"
            raise UsageError(f"{folder}: a ranking of an older version, without {lacks}; rank again")
    except (OSError, ValueError, pa.ArrowException) as error:
        raise UsageError(f"{folder}: no finished ranking ({one_line(error)[:120]}); rank again") from None
    return info, table.select([*_COLUMNS]), moments


def recorded_hours(moments: pa.Table, every_s: float) -> float:
    """Return the recorded time of moments, from the first to the last one of each recording and case."""
    spans: dict[tuple[str, str], list[float]] = {}
    for moment in moments.select(["recording", "case", "time_s"]).to_pylist():
        if moment["time_s"] is not None:
            spans.setdefault((moment["recording"], moment["case"]), []).append(moment["time_s"])
    return sum(max(times) - min(times) + every_s for times in spans.values()) / 3600
