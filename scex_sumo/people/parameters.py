"""Parameters of people: value, unit, meaning and source of each, one frozen set for each kind.

*fitted* values are in ``parameters.json``, which ``benchmarks/fit_people.py`` writes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

SHIPPED: Final = Path(__file__).with_name("parameters.json")


@dataclass(frozen=True, kw_only=True)
class PeopleParameters:
    """Parameters of all pedestrians, or of all cyclists. Comments: unit | meaning | source."""

    # Motion without vehicles
    usual_mps: float  # m/s | median speed of those that start | fitted
    along: tuple[float, ...]  # m, s | way beyond constant velocity: 1, speed, `shown_features` along | fitted
    across: tuple[float, ...]  # s, m | way aside: `shown_features` across | fitted
    speed_spread: float  # 1 | scale of the drawn change of speed within 3 s, over the speed | fitted
    sway_mps: float  # m/s | scale of the drawn velocity of those that stand | fitted
    turn_spread: float  # rad | scale of the drawn change of direction within 3 s | fitted
    settle_s: float = 1.0  # s | time constant of both changes | chosen
    tails: float = 4.0  # 1 | degrees of freedom of Student's draws | chosen
    standing_mps: float = 0.3  # m/s | slower people stand | chosen
    stop_share: float  # 1 | share of those that walk which stop within 3 s, without a vehicle near | fitted
    start_share: float  # 1 | share of those that stand which start within 3 s | fitted
    acceleration_mps2: float  # m/s² | speeding up, and slowing down at ease | chosen
    braking_mps2: float  # m/s² | limit of stopping before a vehicle | chosen
    # Vehicles
    look_s: float = 6.0  # s | time ahead that is looked at | chosen
    gap_s: float  # s | median accepted time between leaving a vehicle's way and its arrival | fitted
    gap_spread_s: float  # s | its standard deviation between people | fitted
    behind_s: float = 0.2  # s | time after a vehicle has left before one enters its way | chosen
    margin_m: float = 0.3  # m | beyond both half widths, on each side | chosen
    stop_m: float = 0.4  # m | from a vehicle's way to where one waits | chosen
    hurry: float = 1.4  # 1 | factor on the speed of those in the way of a vehicle | chosen


@cache
def people_parameters(kind: str) -> PeopleParameters:
    """Return the shipped parameters of ``pedestrian`` or ``bicycle``."""
    given = json.loads(SHIPPED.read_text(encoding="utf-8"))
    values: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in given[kind].items()}
    return PeopleParameters(**values)
