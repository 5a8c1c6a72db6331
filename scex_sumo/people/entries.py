"""Models that the wing registers, and the mix of human-like people."""

from __future__ import annotations

from functools import partial
from typing import Any

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.people.models import (
    Cyclist,
    KeepsWalking,
    Person,
    PersonProfile,
    StepsOut,
    Stops,
    StressProfile,
    Walker,
)

_person = partial(ModelEntry, may_fail=False, is_own=False, takes_guard=False)


def _drawn(make: type[Person], summary: str, place: int) -> ModelEntry:
    return _person(make=make, profile=PersonProfile(), summary=summary, moves=(make.kind,), place=place)


def _stress(make: type[Any], summary: str, place: int) -> ModelEntry:
    return _person(make=make, profile=StressProfile(), summary=summary, moves=PEOPLE, place=place)


WALKER = _drawn(Walker, "a pedestrian drawn for every future: speed, direction, gaps before vehicles", 81)
CYCLIST = _drawn(Cyclist, "a cyclist drawn for every future, as walker", 82)
KEEPS_WALKING = _stress(KeepsWalking, "a person that goes on as shown, whatever comes", 83)
STOPS = _stress(Stops, "a person that stops at once", 84)
STEPS_OUT = _stress(StepsOut, "a person that walks across the way of the vehicle that comes next", 85)
PEOPLE_MIX = "walker,cyclist"
