"""Records behave as the dataclasses of the standard library do."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from functools import cached_property
from typing import Any

import pytest

from scex_sumo import records
from scex_sumo.behaviors.models.likely_driver import LikelyProfile


def declared(dataclass: Any) -> tuple[type[Any], type[Any]]:
    """A class with all that a record can have, and one that inherits from it."""

    @dataclass(frozen=True, kw_only=True)
    class Point:
        """A point."""

        x: float
        y: float = 0.0
        names: list[str] = dataclasses.field(default_factory=list, compare=False)
        hidden: int = dataclasses.field(default=3, repr=False)

        def __post_init__(self) -> None:
            if self.x < 0:
                raise ValueError("x")

        @cached_property
        def double(self) -> float:
            """Twice x."""
            return 2 * self.x

    @dataclass(frozen=True, kw_only=True)
    class Place(Point):
        """A point with a height."""

        z: float = 1.0

    return Point, Place


(Point, Place), (Known, Inherited) = declared(records.dataclass), declared(dataclasses.dataclass)


def test_parameters_are_those_of_a_dataclass() -> None:
    mine, theirs = (dict(inspect.signature(cls).parameters) for cls in (Place, Inherited))
    assert list(mine) == list(theirs)
    assert all(mine[name].kind == theirs[name].kind for name in mine)
    assert [mine[name].default for name in "xyz"] == [theirs[name].default for name in "xyz"]


@pytest.mark.parametrize(("own", "known"), [(Point, Known), (Place, Inherited)])
def test_values_defaults_and_words_are_those_of_a_dataclass(own: Any, known: Any) -> None:
    for given in ({"x": 1.0}, {"y": 2.0, "x": 1.0, "names": ["a"]}):
        mine, theirs = own(**given), known(**given)
        assert vars(mine) == vars(theirs) and list(vars(mine)) == list(vars(theirs))
        assert repr(mine) == repr(theirs)
        assert dataclasses.asdict(mine) == dataclasses.asdict(theirs)
        assert vars(dataclasses.replace(mine, y=5.0)) == vars(dataclasses.replace(theirs, y=5.0))
        assert mine.double == 2.0


def test_records_of_equal_values_are_equal_and_one_key() -> None:
    assert Point(x=1.0, names=["a"]) == Point(x=1.0)
    assert len({Point(x=1.0, names=["a"]), Point(x=1.0), Point(x=2.0)}) == 2
    assert Point(x=1.0) != Place(x=1.0) and Point(x=1.0) != 1.0


def test_a_record_without_comparison_is_equal_to_itself_alone() -> None:
    @records.dataclass(frozen=True, kw_only=True, eq=False)
    class Alone:
        """Not compared."""

        x: float

    one = Alone(x=1.0)
    assert one == one and one != Alone(x=1.0) and len({one, Alone(x=1.0)}) == 2


def test_fields_cannot_be_changed() -> None:
    point = Point(x=1.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match="'x'"):
        point.x = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError, match="'x'"):
        del point.x


def test_missing_unknown_and_impossible_values_are_refused() -> None:
    with pytest.raises(TypeError, match=r"Point\(\) needs x"):
        Point(y=1.0)
    with pytest.raises(TypeError, match=r"Point\(\) has no z"):
        Point(x=1.0, z=2.0)
    with pytest.raises(ValueError, match="x"):
        Place(x=-1.0)


def test_others_are_made_by_the_standard_library() -> None:
    @records.dataclass(frozen=True)
    class Pair:
        """By order."""

        one: int
        two: int

    @records.dataclass(frozen=True, kw_only=True, slots=True)
    class Small:
        """Without a dictionary."""

        one: int

    assert Pair(1, 2) == Pair(two=2, one=1)
    assert not hasattr(Small(one=1), "__dict__")


def test_a_record_is_copied_and_pickled() -> None:
    profile = LikelyProfile(spread=0.5)
    assert copy.copy(profile) == profile == pickle.loads(pickle.dumps(profile))
