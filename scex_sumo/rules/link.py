"""Link of a net through a junction, with its light and right of way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import heading, turn

NO_SIGN = ""  # state of links of which a map says nothing
OPPOSED_RAD, TURNS_RAD = np.deg2rad(135.0), np.deg2rad(30.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """Link of a net from a lane to a lane, with its light (light, index) and the rows to which it yields."""

    line: FloatArray
    lanes: tuple[str, ...]
    junction: str
    row: int
    state: str
    light: tuple[str, int] | None
    yields: frozenset[int]

    @property
    def headings(self) -> tuple[float, float]:
        """Headings at its beginning and its end, rad."""
        return heading(self.line, end=False), heading(self.line, end=True)


def turns_that_wait(links: Sequence[Link]) -> list[Link]:
    """Return the links of a junction without rules, of which those across oncoming traffic yield to it."""
    ways = {link.row: link.headings for link in links}  # not of crosswalks, to which links yield, too

    def comes(row: int, link: Link) -> bool:
        (begins, ends), (mine, my_end) = ways[row], link.headings
        opposed = abs(turn(begins, mine)) > OPPOSED_RAD
        return bool(opposed and abs(turn(begins, ends)) < TURNS_RAD < abs(turn(mine, my_end)))

    oncoming = [frozenset(row for row in link.yields & ways.keys() if comes(row, link)) for link in links]
    return [replace(link, state=NO_SIGN, yields=rows) for link, rows in zip(links, oncoming, strict=True)]
