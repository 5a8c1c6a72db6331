"""Moments of a recording that make seed scenes: their names, and what became of those that failed."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.errors import one_line

if TYPE_CHECKING:
    from scex_sumo.converters.datasets.recordings import Recording
    from scex_sumo.converters.moments.moments import Moment


@dataclass(frozen=True, kw_only=True)
class MomentRef:
    """A moment by name, before its seed scene is built.

    Attributes:
        moment: its name, unique in the ranking and fit for a folder's name; ``seed`` in files.
        location: the site; moments of one site share a map.
        recording: the recording's name.
        case: id of the case, or an empty string.
        time_s: in the recording's clock.
        vehicles: how many vehicles are there.
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
        moment: the moment's name, or the recording's where that cannot be read.
        location: as in `MomentRef`, like those that follow.
        recording: the recording's name.
        case: id of the case.
        time_s: None for a whole recording.
        vehicles: how many.
        reason: one line.
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
        """The failure of a moment."""
        return cls(**asdict(ref), reason=one_line(reason), died=died)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The moments of one recording, in order of time."""

    recording: str
    moments: tuple[MomentRef, ...]


def as_row(known: MomentRef | Failure) -> dict[str, Any]:
    """Plain values under the names that they have in files."""
    values = asdict(known)
    return {"seed": values.pop("moment"), **values}


def from_row(row: dict[str, Any]) -> dict[str, Any]:
    """Arguments of `MomentRef` or `Failure`: the reverse of `as_row`."""
    return {"moment": row["seed"], **{name: value for name, value in row.items() if name != "seed"}}


def read_failures(folder: Path) -> dict[str, Failure]:
    """Failures kept in a folder, by moment; files cut short or edited go, these moments are tried again."""
    found = []
    for file in sorted(folder.glob("*.json")):
        try:
            found.append(Failure(**from_row(json.loads(file.read_text()))))
        except (ValueError, KeyError, TypeError):
            file.unlink()
    return {failure.moment: failure for failure in found}


def list_moments(recording: Recording, moments: Sequence[Moment], *, min_vehicles: int) -> Listing:
    """Moments of a recording that have enough vehicles.

    Args:
        recording: names them.
        moments: candidates; those of cases are taken with ``min_vehicles`` vehicles, those of a recording
            with as many that move and are recorded from 1 s before to 3 s after.
        min_vehicles: least number of vehicles.
    """
    refs = [
        MomentRef(
            moment=moment_name(recording.name, m.case, m.time_s),
            location=plain(recording.site),
            recording=recording.name,
            case=m.case,
            time_s=m.time_s,
            vehicles=m.vehicles,
        )
        for m in moments
        if (m.vehicles if m.case else m.complete) >= min_vehicles
    ]
    return Listing(recording=recording.name, moments=tuple(refs))


def unreadable(recording: Recording, reason: str) -> Failure:
    """The failure of a recording that cannot be read."""
    name, location = plain(recording.name), plain(recording.site)
    return Failure(moment=name, location=location, recording=recording.name, reason=one_line(reason))


def moment_name(recording: str, case: str, time_s: float) -> str:
    """Name of a moment: recording, case if any, and time, to the millisecond where it needs that."""
    when = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    return plain(f"{recording}_case{case}_t{when}" if case else f"{recording}_t{when}")


def plain(name: str) -> str:
    """A name with nothing in it that the path of a partition would have to escape."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)
