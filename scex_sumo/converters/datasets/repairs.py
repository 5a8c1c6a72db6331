"""Registry of repairs: what is done to a recording before moments are cut out of it.

An entry is a `Repair`, or a module or object with some of its attributes. Without entries recordings stay as
read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cache
from typing import TypeAlias

from scex_sumo.base.importing import Registry
from scex_sumo.converters.datasets.checks import Check
from scex_sumo.converters.tracks.evidence import Evidence
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.road import Road

REPAIRS = Registry(group="scex_sumo.repairs", kind="repair of recordings")

Phrases: TypeAlias = tuple[str, ...]
Siblings: TypeAlias = Iterable[tuple[str, Evidence]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Repair:
    """Repair of recordings. Each function may be left out.

    Attributes:
        order: repairs with smaller numbers come first, those of one number by name.
        check: ``check(rows, road)`` judges a recording's vehicles as read; the road may be None.
        tracks: ``tracks(table, exact=...)`` repairs a recording, or one case of a file of cases, at the rate
            at which it was recorded; exact recordings are from a simulation. It gives the table, and a phrase
            for each kind of defect.
        align: ``align(table, road, siblings=...)`` moves a recording at 10 Hz onto the lanes of its map, with
            a phrase about the shift. ``siblings`` are other recordings of the site, name and evidence.
        doubt: ``doubt(samples, road)`` warns that tracks seem to lie at a wrong place of the map; else None.
        explain: ``explain(samples, road)`` says why tracks do not lie on a map's lanes, with the remedy; else
            an empty string.
    """

    order: int = 0
    check: Callable[[TrackRows, Road | None], tuple[Check, ...]] = lambda rows, road: ()
    tracks: Callable[..., tuple[TrackTable, Phrases]] = lambda table, exact: (table, ())
    align: Callable[..., tuple[TrackTable, Phrases]] = lambda table, road, siblings: (table, ())
    doubt: Callable[[Evidence, Road], str | None] = lambda samples, road: None
    explain: Callable[[Evidence, Road], str] = lambda samples, road: ""


@cache
def _repairs() -> tuple[Repair, ...]:
    entries = [REPAIRS.load(name) for name in sorted(REPAIRS.paths)]
    names = [part.name for part in fields(Repair)]
    made = [Repair(**{n: getattr(entry, n) for n in names if hasattr(entry, n)}) for entry in entries]
    return tuple(sorted(made, key=lambda repair: repair.order))


def check_recording(rows: TrackRows, road: Road | None) -> tuple[Check, ...]:
    """Judge the vehicles of a recording as it was read."""
    return tuple(check for repair in _repairs() for check in repair.check(rows, road))


def repair_tracks(table: TrackTable, *, exact: bool = False) -> tuple[TrackTable, Phrases]:
    """Repair a recording, or one case of a file of cases.

    Returns a phrase for each kind of defect, too; the first one says what is left out.
    """
    findings: Phrases = ()
    before = table
    for repair in _repairs():
        table, more = repair.tracks(table, exact=exact)
        findings += tuple(more)
    rows, kept = (len(one.vehicles) + len(one.others) for one in (before, table))
    vehicles, left = before.vehicles.tracks, before.vehicles.tracks - table.vehicles.tracks
    who = f"{left} of {vehicles} vehicles and " if left else ""
    cost = (f"{who}{rows - kept} of {rows} rows left out",) if rows > kept else ()
    return table, (*cost, *findings)


def align_tracks(table: TrackTable, road: Road, *, siblings: Siblings = ()) -> tuple[TrackTable, Phrases]:
    """Move a recording onto the lanes of its map if its vehicles drive beside them; a phrase about it."""
    findings: Phrases = ()
    for repair in _repairs():
        table, more = repair.align(table, road, siblings=siblings)
        findings += tuple(more)
    return table, findings


def doubt_place(samples: Evidence, road: Road) -> str | None:
    """Return a warning if tracks seem to lie at a wrong place of the map."""
    return next(filter(None, (repair.doubt(samples, road) for repair in _repairs())), None)


def explain_mismatch(samples: Evidence, road: Road) -> str:
    """Explain why tracks do not lie on a map's lanes: a phrase with the remedy."""
    reasons = (repair.explain(samples, road) for repair in _repairs())
    return next(
        filter(None, reasons), "the map is another site's, or its origin wrong; give --origin LAT,LON"
    )
