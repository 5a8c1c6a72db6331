"""Moments by name, listings of recordings, and failures, with their form in files."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

from scex_sumo.base.errors import one_line


@dataclass(frozen=True, kw_only=True)
class MomentRef:
    """A moment by name, before its seed scene is built.

    Attributes:
        moment: unique in a study, fit for a folder's name; ``seed`` in files.
        location: the site; moments of one site share a map.
        case: id of the case, or an empty string.
        time_s: in the recording's clock.
    """

    moment: str
    location: str
    recording: str
    case: str
    time_s: float
    vehicles: int


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a moment, or a whole recording, has no result.

    Attributes:
        moment: the moment's name, or the recording's.
        time_s: None for a whole recording.
        died: a worker died; the next run of the same command tries again.
    """

    moment: str
    location: str
    recording: str
    case: str = ""
    time_s: float | None = None
    vehicles: int = 0
    reason: str = ""
    died: bool = False

    @classmethod
    def of(cls, ref: MomentRef, reason: str, *, died: bool = False) -> Failure:
        """Return the failure of a moment."""
        return cls(**asdict(ref), reason=one_line(reason), died=died)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The moments of one recording, in order of time."""

    recording: str
    moments: tuple[MomentRef, ...]


def as_row(named: MomentRef | Failure) -> dict[str, Any]:
    """Return the values under their names in files."""
    values = asdict(named)
    return {"seed": values.pop("moment"), **values}


def from_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of `MomentRef` or `Failure`; the reverse of `as_row`."""
    return {"moment": row["seed"], **{name: value for name, value in row.items() if name != "seed"}}


def moment_name(recording: str, case: str, time_s: float) -> str:
    """Name a moment by recording, case and time, in milliseconds if needed."""
    when = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    return plain(f"{recording}_case{case}_t{when}" if case else f"{recording}_t{when}")


def plain(name: str) -> str:
    """Replace the characters that the path of a partition would have to escape."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)
