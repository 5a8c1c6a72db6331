"""Which seed scenes a recording is cut into."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from scex_sumo.errors import ScexError

if TYPE_CHECKING:
    from scex_sumo.converters.datasets.recordings import Recording
    from scex_sumo.converters.moments.moments import Moment


@dataclass(frozen=True, kw_only=True)
class SeedRef:
    """A seed scene by name, before it is built.

    Attributes:
        seed: its name, unique in the ranking and fit for a folder's name.
        location: the site; seeds of one site share a map.
        recording: the recording's name.
        case: id of the case, or an empty string.
        time_s: the moment in the recording's clock.
        vehicles: how many vehicles are there.
    """

    seed: str
    location: str
    recording: str
    case: str
    time_s: float
    vehicles: int


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a seed, or a whole recording, has no result.

    Attributes:
        seed: the seed's name, or the recording's where that cannot be read.
        location: the site.
        recording: the recording's name.
        case: as in `SeedRef`.
        time_s: the moment; None for a whole recording.
        vehicles: as in `SeedRef`.
        reason: one line.
        died: a worker died; the next run of the same command tries again.
    """

    seed: str
    location: str
    recording: str
    case: str = ""
    time_s: float | None = None
    vehicles: int = 0
    reason: str = ""
    died: bool = False

    @classmethod
    def of(cls, ref: SeedRef, reason: str, *, died: bool = False) -> Failure:
        """The failure of a seed."""
        return cls(**asdict(ref), reason=one_line(reason), died=died)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The seeds of one recording, or why it has none.

    Attributes:
        recording: the recording's name.
        seeds: in order of time.
        failure: None where the recording could be read.
    """

    recording: str
    seeds: tuple[SeedRef, ...] = ()
    failure: Failure | None = None

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Listing:
        """The reverse of `to_json`."""
        failure = content["failure"]
        return cls(
            recording=content["recording"],
            seeds=tuple(SeedRef(**seed) for seed in content["seeds"]),
            failure=None if failure is None else Failure(**failure),
        )


def list_seeds(recording: Recording, moments: Sequence[Moment], *, min_vehicles: int) -> Listing:
    """The seeds among the moments of a recording.

    Args:
        recording: names them.
        moments: candidates; those of cases are taken with ``min_vehicles`` vehicles, those of a recording
            with as many that move and are recorded from 1 s before to 3 s after.
        min_vehicles: least number of vehicles.
    """
    enough = [m for m in moments if (m.vehicles if m.case else m.complete) >= min_vehicles]
    return Listing(
        recording=recording.name,
        seeds=tuple(
            SeedRef(
                seed=seed_name(recording.name, m.case, m.time_s),
                location=plain(recording.site),
                recording=recording.name,
                case=m.case,
                time_s=m.time_s,
                vehicles=m.vehicles,
            )
            for m in enough
        ),
    )


def unreadable(recording: Recording, reason: str) -> Listing:
    """The listing of a recording that cannot be read."""
    failure = Failure(
        seed=plain(recording.name),
        location=plain(recording.site),
        recording=recording.name,
        reason=one_line(reason),
    )
    return Listing(recording=recording.name, failure=failure)


def seed_name(recording: str, case: str, time_s: float) -> str:
    """Name of a seed: recording, case if any, and time, to the millisecond where it needs that."""
    when = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    return plain(f"{recording}_case{case}_t{when}" if case else f"{recording}_t{when}")


def plain(name: str) -> str:
    """A name with nothing in it that the path of a partition would have to escape."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)


def reason_of(error: Exception) -> str:
    """What an error says, in one line; its kind too where it is none of ours."""
    said = one_line(str(error))
    return said if isinstance(error, ScexError) else f"{type(error).__name__}: {said}"


def one_line(reason: str) -> str:
    """A message without line breaks."""
    return " ".join(reason.split()) or "no reason given"
