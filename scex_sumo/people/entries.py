"""Models that the wing registers, and the mix that people draw from if no model is given."""

from __future__ import annotations

from functools import partial

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.people.models import (
    KeepsWay,
    KeepsWayProfile,
    StepsOut,
    StepsOutProfile,
    Stops,
    StopsProfile,
)

_person = partial(ModelEntry, may_fail=False, is_own=False, takes_guard=False, moves=PEOPLE)

KEEPS_WAY = _person(
    make=KeepsWay,
    profile=KeepsWayProfile(),
    summary="a person that keeps its velocity, and waits for vehicles that come",
    place=81,
)
STOPS = _person(make=Stops, profile=StopsProfile(), summary="a person that stops at once", place=82)
STEPS_OUT = _person(
    make=StepsOut,
    profile=StepsOutProfile(),
    summary="a person that walks across the line of the vehicle that comes next",
    place=83,
)
