"""Parameters of people: value, unit, meaning and source of each, one frozen set for each kind.

*fitted* values are in ``parameters.json``, which ``benchmarks/fit_people.py`` writes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

SHIPPED: Final = Path(__file__).with_name("parameters.json")


@dataclass(frozen=True, kw_only=True)
class PeopleParameters:
    """Parameters of all pedestrians, or of all cyclists. Comments: unit | meaning | source."""

    # Motion without vehicles
    usual_mps: float  # m/s | median speed of those that start | fitted
    usual_spread: float = 0.15  # 1 | standard deviation of its logarithm | chosen
    sway_mps: float  # m/s | scale of the drawn velocity of those that stand | fitted
    settle_s: float = 1.0  # s | time constant of changes of velocity | chosen
    tails: float = 4.0  # 1 | degrees of freedom of Student's draws | chosen
    standing_mps: float = 0.3  # m/s | slower people stand | chosen
    stop_share: float  # 1 | share of those that walk which stop within 3 s, without a vehicle near | fitted
    start_share: float  # 1 | share of those that stand which start within 3 s | fitted
    acceleration_mps2: float  # m/s² | speeding up, and slowing down at ease | chosen
    braking_mps2: float  # m/s² | limit of stopping before a vehicle | chosen
    headway_s: float = 0.8  # s | behind vehicles, of cyclists; so the least gap | chosen
    least_gap_m: float = 0.8  # m | chosen
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
    return PeopleParameters(**given[kind])
