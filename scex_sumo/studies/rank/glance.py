"""Recordings of a ranking at a glance: a time line of each, and a map of each site with the places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.page.document import card
from scex_sumo.page.html import Html, element
from scex_sumo.page.report.scene import Box
from scex_sumo.page.timeline import Happening, place_map, shapes_legend, timeline, usual_level
from scex_sumo.results.tables.pairs import TOLD
from scex_sumo.studies.moments.folder import MomentRef

_MOST: Final = 12  # recordings
_PLACES: Final = 200  # of a site
_AROUND_M: Final = 30.0
_HOW: Final = (
    "Each mark is the most critical pair of a moment: P of a contact between people, on a log scale. The "
    "pointer on a mark names the pair; a click leads to its card, else to its row. A drag selects a "
    "span for the table."
)

Cards = Mapping[str, Mapping[str, Any]]
"""Encounters that have cards, by the addresses of these."""


def places_of(ranking: pa.Table) -> dict[str, list[dict[str, Any]]]:
    """Return the encounters that a map shows, by site: the first ones without doubt."""
    is_told = pc.greater_equal(ranking["probability"], TOLD)
    places: dict[str, list[dict[str, Any]]] = {}
    for row in ranking.filter(pc.and_(pc.is_valid(ranking["rank"]), is_told)).to_pylist():
        own = places.setdefault(row["location"], [])
        if len(own) < _PLACES:
            own.append(row)
    return places


def box_of(rows: Sequence[Mapping[str, Any]]) -> Box:
    """Return the box of a map with these places, m."""
    x, y = [row["x"] for row in rows], [row["y"] for row in rows]
    return min(x) - _AROUND_M, max(x) + _AROUND_M, min(y) - _AROUND_M, max(y) + _AROUND_M


def glance(
    pairs: Sequence[tuple[MomentRef, pa.Table]],
    places: Mapping[str, Sequence[Mapping[str, Any]]],
    roads: Mapping[str, Html],
    cards: Cards,
) -> Html:
    """Return the time lines of the most critical recordings, and the maps.

    Args:
        pairs: moments, and their pairs as of `pairs_of_moment`.
        places: as of `places_of`; ``roads`` of the sites that have one.
        cards: of encounters on the page.
    """
    lines, levels = dict[str, list[Happening]](), dict[str, list[float]]()
    for ref, table in pairs:
        for row in table.filter(pc.is_null(table["doubt"])).slice(0, 1).to_pylist():
            happening = Happening.of(row, ref.time_s, _link(row, ref.recording, ref.time_s, cards))
            lines.setdefault(ref.recording, []).append(happening)
            levels.setdefault(ref.location, []).append(happening.probability)
    usual = {ref.recording: usual_level(levels.get(ref.location, ())) for ref, _ in pairs}
    by_peak = sorted(lines, key=lambda name: -max(one.probability for one in lines[name]))
    figures, maps = list[Html](), list[Html]()
    for name, marks in lines.items():
        if name in by_peak[:_MOST]:
            times = [one.time_s for one in marks]
            figures.append(timeline(name, marks, (min(times), max(times)), name, usual[name]))
    for site, rows in places.items():
        if site in roads:
            links = (_link(row, row["recording"], row["time_s"], cards) for row in rows)
            marks = [Happening.of(row, row["time_s"], link) for row, link in zip(rows, links, strict=True)]
            maps.append(place_map(site, box_of(rows), roads[site], marks))
    kinds = {one.what for marks in lines.values() for one in marks}
    legend = shapes_legend(kinds, usual=any(usual.values()))
    more = f" Shown are the {_MOST} most critical of {len(lines)} recordings." if len(lines) > _MOST else ""
    return card("At a glance", _HOW + more, legend, *figures, element("div.maps", *maps))


def _link(row: Mapping[str, Any], recording: str, time_s: float, cards: Cards) -> str:
    both = {row["track_id"], row["other_id"]}
    for address, one in cards.items():
        is_pair = one["recording"] == recording and {one["track_id"], one["other_id"]} == both
        if is_pair and one["first_s"] <= time_s <= one["last_s"]:
            return address
    return ""
