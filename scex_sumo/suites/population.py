"""Population of a catalogue: the encounters of rankings, one candidate for each vehicle that can be tested.

In a candidate the function takes the place of the responder. So an encounter in which either vehicle may act
is two candidates. Encounters with doubtful data are left out, and counted.
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

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError, one_line
from scex_sumo.certainty.response.typology import CONFLICTS
from scex_sumo.studies.moments.pairs import OWN, PARAMETERS

LEAST: Final = 1e-9
"""P of a contact from which a vehicle of an encounter is a candidate."""
RISKS: Final = (1e-7, 1e-6, 1e-5)
"""P between classes of risk."""
RISK_WORDS: Final = ("below 1e-7", "1e-7 to 1e-6", "1e-6 to 1e-5", "1e-5 or more")
_SAME: Final = ("location", "recording", "case", "seed", "time_s", "takes", "kind", "conflict", "factor")
_NEEDED: Final = (
    *("track_id", "other_id", "person", "action", "value", "probability", "severity", "needed_braking"),
    *("first_s", "last_s", "doubt", *_SAME, *PARAMETERS, *OWN),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """Candidates of a data set.

    Attributes:
        rows: one for each; ``other_id`` is the vehicle that the function drives, ``track_id`` the other one.
        hours: recorded time.
        doubtful: encounters left out.
        roots: of the recordings.
        seeds: number of moments.
    """

    rows: Sequence[Mapping[str, Any]]
    hours: float
    encounters: int
    doubtful: int
    roots: Sequence[str]
    seeds: int

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def kinds(self) -> list[str]:
        """Kinds of the candidates, (N,)."""
        return [row["conflict"] for row in self.rows]

    def column(self, name: str) -> FloatArray:
        """Return the (N,) values of a column."""
        return np.array([row[name] for row in self.rows], dtype=np.float64)

    @property
    def risk(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Class of risk (N,), an index into `RISK_WORDS`."""
        return np.searchsorted(RISKS, self.column("probability"), side="right").astype(np.int64)

    def size(self) -> FloatArray:
        """Return (N,) the share of each candidate in the draw: half is even, half goes by P of people."""
        chance = self.column("probability")
        return np.asarray(0.5 / len(self) + 0.5 * chance / chance.sum())

    def exposure(self) -> list[dict[str, Any]]:
        """Return by kind how many candidates and contacts of people there are, and how many an hour."""
        kinds, chance = np.array(self.kinds), self.column("probability")
        severity = self.column("severity")
        return [
            {
                "kind": kind,
                "candidates": int((kinds == kind).sum()),
                "per_hour": float((kinds == kind).sum() / self.hours),
                "people_collide_per_hour": float(chance[kinds == kind].sum() / self.hours),
                "people_severe_per_hour": float(severity[kinds == kind].sum() / self.hours),
            }
            for kind in CONFLICTS
            if (kinds == kind).any()
        ]


def is_ranking(folder: Path) -> bool:
    """Whether a folder is a finished ranking."""
    return (folder / "rank.json").is_file()


def read_population(folders: Sequence[Path]) -> Population:
    """Read the candidates of finished rankings.

    Raises:
        UsageError: one cannot be read, is of an older version, or none has an encounter.
    """
    rows: list[dict[str, Any]] = []
    roots, hours, doubtful, encounters, seeds = [], 0.0, 0, 0, 0
    for folder in folders:
        info, table, moments = _read(folder)
        roots += [root for root in info["roots"] if root not in roots]
        hours += recorded_hours(moments, float(info["every_s"]))
        seeds += int(info["seeds"])
        sure = table.filter(pc.is_null(table["doubt"]))
        doubtful += len(table) - len(sure)
        encounters += len(sure)
        for row in sure.to_pylist():
            rows += candidates_of(row)
    if not rows:
        raise UsageError(
            f"{', '.join(map(str, folders))}: no encounter without doubt; nothing to choose from"
        )
    return Population(
        rows=rows,
        hours=hours,
        encounters=encounters,
        doubtful=doubtful,
        roots=roots,
        seeds=seeds,
    )


def _read(folder: Path) -> tuple[dict[str, Any], pa.Table, pa.Table]:
    try:
        info = json.loads((folder / "rank.json").read_bytes())
        table = pq.read_table((folder / "ranking.parquet").absolute())
        moments = pq.read_table((folder / "moments.parquet").absolute())
        missing = [name for name in _NEEDED if name not in table.column_names]
        if missing or "roots" not in info:
            lacks = missing[0] if missing else "roots"
            raise UsageError(f"{folder}: a ranking of an older version, without {lacks}; rank again")
    except (OSError, ValueError, pa.ArrowException) as error:
        raise UsageError(f"{folder}: no finished ranking ({one_line(error)[:120]}); rank again") from None
    return info, table.select([*_NEEDED]), moments


def recorded_hours(moments: pa.Table, every_s: float) -> float:
    """Return the recorded time of moments, from the first to the last one of each recording and case."""
    spans: dict[tuple[str, str], list[float]] = {}
    for row in moments.select(["recording", "case", "time_s"]).to_pylist():
        if row["time_s"] is not None:
            spans.setdefault((row["recording"], row["case"]), []).append(row["time_s"])
    return sum(max(times) - min(times) + every_s for times in spans.values()) / 3600


def candidates_of(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the one or two candidates of an encounter: as it is told, and with the roles exchanged."""
    same = {name: row[name] for name in _SAME}
    told = {name: row[name] for name in (*PARAMETERS, "track_id", "other_id", "person", "needed_braking")}
    told |= {name.removeprefix("own_"): row[name] for name in OWN}
    back = 1 - (1 - row["probability"]) / (1 - min(row["own_probability"], 1 - 1e-12))
    candidates = [same | told]
    if row["person"] is None and back >= LEAST:
        candidates.append(
            same | _exchanged(row) | {"probability": back, "person": None, "needed_braking": None}
        )
    return [one for one in candidates if one["probability"] >= LEAST]


def _exchanged(row: Mapping[str, Any]) -> dict[str, Any]:
    values = {"track_id": row["other_id"], "other_id": row["track_id"]}
    values |= {"severity": max(row["severity"] - row["own_severity"], 0.0), "takes": None}
    for name in PARAMETERS:
        other = name.removeprefix("other_") if name.startswith("other_") else f"other_{name}"
        values[name] = row[other] if other in PARAMETERS else row[name]
    return values
