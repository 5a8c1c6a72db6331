"""Link of a net through a junction, with its light and right of way."""

from __future__ import annotations

from dataclasses import dataclass

from scex_sumo.base.arrays import FloatArray


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
