"""Usual P: the place of an encounter among the encounters of its reference class in a data set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import UsageError, one_line


@dataclass(frozen=True, kw_only=True)
class Usual:
    """What is usual where an encounter takes place, and its place there.

    Attributes:
        median: P(collision), human-like, of the encounters of the class.
        rank: place of the encounter by P, 1 for the largest.
        of: number of encounters that have a place, this one included.
        what: the class, in words that follow "usual": "at this site", "in the whole data set".
    """

    median: float
    rank: int
    of: int
    what: str

    def words(self, probability: float) -> str:
        """Return the place of P in words: "30 × the median at this site, 2nd of 148"."""
        if not self.median:
            return f"the median {self.what} is 0, {ordinal(self.rank)} of {self.of}"
        times = f"{float(f'{probability / self.median:.1g}'):,.6g}".replace(",", " ")
        return f"{times} × the median {self.what}, {ordinal(self.rank)} of {self.of}"


NEAR_M: Final = 10.0
"""Encounters that come as near as this say what is usual."""
AT_SITE: Final = "at this site"
IN_ALL: Final = "in the whole data set"
LEAST: Final = 20
"""Encounters of one site and kind; with fewer the whole data set is the class."""
FILES: Final = ("ranking.parquet", "encounters.parquet")
"""Encounters of a ranking, and of a validation."""
_USED = ("location", "kind", "probability", "gap_m", "doubt")


class Population:
    """P of the encounters of a data set that come within 10 m and whose data are not doubtful."""

    def __init__(self, encounters: pa.Table) -> None:
        """Sort the encounters of a ranking by site and kind."""
        classes: dict[tuple[str, str | None], list[float]] = {}
        for row in encounters.select(_USED).to_pylist():
            if counts(row):
                classes.setdefault((row["location"], row["kind"]), []).append(row["probability"])
        self._classes = {key: np.sort(values) for key, values in classes.items()}
        self._whole = np.sort(np.concatenate([np.zeros(0), *self._classes.values()]))

    @classmethod
    def read(cls, ranking: Path) -> Population:
        """Read the encounters of a finished ranking, or validation with ``--usual``, by its folder.

        Raises:
            UsageError: there is none.
        """
        file = next((ranking / name for name in FILES if (ranking / name).is_file()), ranking / FILES[0])
        try:
            return cls(pq.read_table(file, columns=[*_USED]))
        except (OSError, pa.ArrowInvalid) as error:
            raise UsageError(
                f"{ranking}: no finished ranking ({one_line(error)}); make one with 'scex-sumo rank'"
            ) from None

    def site_of(self, location: str) -> str:
        """Return the site that a scene's location names, maybe with the number of a scenario behind it."""
        sites = [site for site, _ in self._classes if location == site or location.startswith(f"{site}_")]
        return max(sites, key=len, default=location)

    def usual(
        self, site: str, kind: str | None, probability: float, *, counted: bool = False
    ) -> Usual | None:
        """Return what is usual for an encounter; None for an empty data set.

        Args:
            counted: it is one of the data set.
        """
        values, what = self._classes.get((site, kind), self._whole), AT_SITE
        if len(values) < LEAST:
            values, what = self._whole, IN_ALL
        if not len(values):
            return None
        above = len(values) - int(np.searchsorted(values, probability, side="right"))
        count = len(values) + (not counted)
        return Usual(median=float(np.median(values)), rank=1 + above, of=count, what=what)


USUAL: Final = {
    "usual": pa.float64(),
    "usual_rank": pa.int64(),
    "usual_of": pa.int64(),
    "usual_what": pa.string(),
}
"""Columns of a `Usual`; null without any."""


def usual_columns(usual: Sequence[Usual | None]) -> dict[str, list[Any]]:
    """Return the columns of `USUAL`."""
    rows = [astuple(one) if one else (None,) * len(USUAL) for one in usual]
    return {name: [row[k] for row in rows] for k, name in enumerate(USUAL)}


def usual_of(row: Mapping[str, Any]) -> Usual | None:
    """Return what is usual by a row with the columns of `USUAL`."""
    if row.get("usual_of") is None:
        return None
    names = zip(("median", "rank", "of", "what"), USUAL, strict=True)
    return Usual(**{name: row[column] for name, column in names})


def counts(row: Mapping[str, Any]) -> bool:
    """Whether an encounter says what is usual."""
    return row["doubt"] is None and row["gap_m"] <= NEAR_M


def ordinal(number: int) -> str:
    """Return 1st, 2nd, 3rd, 4th, ..., 11th."""
    end = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{end}"
