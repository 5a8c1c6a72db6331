"""Conflicts that SUMO's SSM device saw, and how long before the extrapolation saw them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from scex_sumo.live.risk import Risk

SEEN: Final = 1e-4
"""Human-like P from which the extrapolation has seen a pair."""
BEFORE_S: Final = 10.0
"""Moments up to so long before a conflict can be about it."""
LIMITS: Final = {"TTC": 3.0, "DRAC": 3.0, "PET": 2.0}
"""SUMO's thresholds, s, m/s², s."""


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """Conflict of the SSM device.

    Attributes:
        pair: SUMO's names.
        begin_s: first time at which a measure exceeds SUMO's threshold.
        what: the measure, and its most critical value.
    """

    pair: frozenset[str]
    begin_s: float
    what: str
    value: float


@dataclass(frozen=True, kw_only=True)
class Lead:
    """Conflict and the moment in which the extrapolation saw it first; one of the two may be missing."""

    pair: tuple[str, str]
    conflict_s: float | None
    what: str | None
    value: float | None
    risk_s: float | None
    human_like: float | None

    @property
    def lead_s(self) -> float | None:
        """Time between the two, s."""
        if self.conflict_s is None or self.risk_s is None:
            return None
        return self.conflict_s - self.risk_s


def conflicts_of(file: Path) -> list[Conflict]:
    """Return the conflicts in a file of the SSM device with trajectories, each pair's first, by time."""
    first: dict[frozenset[str], Conflict] = {}
    for conflict in elements_of(file):
        pair = frozenset((conflict.get("ego", ""), conflict.get("foe", "")))
        for what, begin_s, value in _exceeded(conflict):
            if pair not in first or begin_s < first[pair].begin_s:
                first[pair] = Conflict(pair=pair, begin_s=begin_s, what=what, value=value)
    return sorted(first.values(), key=lambda one: one.begin_s)


def elements_of(file: Path) -> Iterator[ElementTree.Element]:
    """Yield the conflicts of a file of the SSM device, up to its end or where it was cut."""
    try:
        for _, element in ElementTree.iterparse(file):
            if element.tag == "conflict":
                yield element
                element.clear()
    except (OSError, ElementTree.ParseError):  # SUMO was killed in the middle of it
        return


def _exceeded(conflict: ElementTree.Element) -> Iterator[tuple[str, float, float]]:
    times = numbers_of(conflict, "timeSpan")
    for what, worse in (("TTC", min), ("DRAC", max)):
        values = numbers_of(conflict, f"{what}Span")
        limit = LIMITS[what]
        over = [
            (time_s, value)
            for time_s, value in zip(times, values, strict=False)
            if (value <= limit if worse is min else value >= limit)
        ]
        if over:
            yield what, over[0][0], worse(value for _, value in over)
    pet = conflict.find("PET")
    if pet is not None and pet.get("value", "NA") != "NA" and float(pet.get("value", "")) <= LIMITS["PET"]:
        yield "PET", float(pet.get("time", "nan")), float(pet.get("value", ""))


def numbers_of(conflict: ElementTree.Element, tag: str) -> list[float]:
    """Return the numbers of a conflict's time series; NaN where the device has none."""
    span = conflict.find(tag)
    text = "" if span is None else span.get("values", "")
    return [math.nan if word == "NA" else float(word) for word in text.split()]


def leads_of(conflicts: Sequence[Conflict], risks: Sequence[Risk], *, level: float = SEEN) -> list[Lead]:
    """Return each conflict with the first moment before it in which its pair has this P, then other pairs.

    Conflicts before the first risk are left out.
    """
    seen: dict[frozenset[str], list[tuple[float, float, tuple[str, str]]]] = {}
    for risk in risks:
        for pair in risk.pairs:
            if pair.human_like >= level and pair.doubt is None:
                moment = (risk.time_s, pair.human_like, pair.names)
                seen.setdefault(frozenset(pair.names), []).append(moment)
    leads, first_s = [], min((risk.time_s for risk in risks), default=math.inf)
    for one in (one for one in conflicts if one.begin_s >= first_s):
        before = [m for m in seen.get(one.pair, ()) if one.begin_s - BEFORE_S <= m[0] <= one.begin_s + 1e-6]
        first = before[0] if before else None
        one_name, other = sorted(one.pair) if len(one.pair) == 2 else [*one.pair, ""][:2]
        leads.append(
            Lead(
                pair=first[2] if first else (one_name, other),
                conflict_s=one.begin_s,
                what=one.what,
                value=one.value,
                risk_s=first[0] if first else None,
                human_like=first[1] if first else None,
            )
        )
    known = {one.pair for one in conflicts}
    for key, moments in seen.items():
        if key not in known:
            time_s, human_like, names = moments[0]
            only = Lead(
                pair=names, conflict_s=None, what=None, value=None, risk_s=time_s, human_like=human_like
            )
            leads.append(only)
    return leads
