"""Checks of a recording as a whole: their verdicts, warnings and errors."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.tracks.rows import TrackTable

SOME_LOST, MOST_LOST = 0.1, 0.5  # shares of the vehicles
Verdict = Literal["", "repaired", "warning", "error"]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One row of the table.

    Attributes:
        value: what was measured; ``-`` if the recording has too little for it.
        usual: what is plausible.
        verdict: ``repaired``: the reader does so; ``error``: a run would mean nothing.
        problem: what is wrong, the likely cause and the remedy; empty if plausible.
        pairs: track ids of vehicles that are recorded twice; the problem is only theirs.
        explains: beginning of the phrases about repairs whose true cause this is.
    """

    name: str
    value: str
    usual: str
    verdict: Verdict = ""
    problem: str = ""
    pairs: tuple[tuple[str, str], ...] = ()
    explains: str = ""


def refuse_implausible(name: object, checks: Sequence[Check], remedy: str) -> None:
    """Raise a `TrackError` for the checks after which a run means nothing."""
    if wrong := [check.problem for check in checks if check.verdict == "error"]:
        raise TrackError(f"{name}: {'; '.join(wrong)}; {remedy}")


def lost_vehicles(before: TrackTable, after: TrackTable) -> Check:
    """Judge how many vehicles of a recording its repairs leave out."""
    vehicles, lost = before.vehicles.tracks, before.vehicles.tracks - after.vehicles.tracks
    share = lost / max(vehicles, 1)
    name, usual = "vehicles left out by repairs", f"up to {SOME_LOST:.0%}"
    check = Check(name=name, value=f"{share:.0%}", usual=usual)
    if share <= SOME_LOST:
        return check
    problem = f"repairs leave out {lost} of {vehicles} vehicles: mend the tracks"
    return replace(check, verdict="error" if share > MOST_LOST else "warning", problem=problem)


def doubts(checks: Sequence[Check], present: Collection[str] = ()) -> tuple[str, ...]:
    """Return a warning for each check that neither passed nor is repaired; of pairs those ``present``."""
    warnings = []
    for check in checks:
        problem = check.problem
        if check.pairs:
            problem = twice([pair for pair in check.pairs if set(pair) <= set(present)])
        if problem and check.verdict != "repaired":
            warnings.append(f"warning: {problem}")
    return tuple(warnings)


def without_explained(findings: Sequence[str], checks: Sequence[Check]) -> tuple[str, ...]:
    """Leave out phrases about repairs whose true cause a check names."""
    begins = tuple(check.explains for check in checks if check.explains)
    return tuple(finding for finding in findings if not (begins and finding.startswith(begins)))


def twice(pairs: Sequence[tuple[str, str]]) -> str:
    """Return the problem of vehicles that are recorded twice; empty without any."""
    names = listed(f"{a} and {b}" for a, b in pairs)
    why = "overlap all the time: probably one vehicle recorded twice; leave one out"
    return f"tracks {names} {why}" if pairs else ""
