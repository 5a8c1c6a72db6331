"""JSON from outside fits its schema, or is one line that says where it does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.base.schema import (
    COUNT,
    NUMBER,
    PLAIN_NAME,
    SHARE,
    TEXT,
    faults,
    listed,
    or_null,
    parse_json,
    read_json,
    record,
)

CAR = record({"name": TEXT, "speeds": listed(NUMBER, 1)}, {"seats": COUNT, "risk": or_null(SHARE)})


def test_what_fits_has_no_fault() -> None:
    car = {"name": "a", "speeds": [1, 2.5], "seats": 4, "risk": None, "of_others": {"nobody": "reads"}}
    assert [*faults(car, CAR)] == []


@pytest.mark.parametrize(
    ("car", "says"),
    [
        ([], "the content is [], needs object"),
        ({"speeds": [1]}, "has no name"),
        ({"name": None, "speeds": [1]}, "name is null, needs string"),
        ({"name": "a", "speeds": []}, "speeds has 0 entries"),
        ({"name": "a", "speeds": [1, "2"]}, 'speeds[1] is "2", needs number'),
        ({"name": "a", "speeds": [float("inf")]}, "speeds[0] is Infinity, needs number"),
        ({"name": "a", "speeds": [True]}, "speeds[0] is true, needs number"),
        ({"name": "a", "speeds": [10**30]}, f"speeds[0] is {10**30}, needs number"),
        ({"name": "a", "speeds": [1], "seats": -1}, "seats is -1, needs at least 0"),
        ({"name": "a", "speeds": [1], "seats": 4.0}, "seats is 4.0, needs integer"),
        ({"name": "a", "speeds": [1], "risk": 1.5}, "risk is 1.5, needs at most 1"),
    ],
)
def test_what_does_not_fit_is_named_with_its_place(car: Any, says: str) -> None:
    assert next(faults(car, CAR)) == says


def test_members_are_closed_where_a_schema_says_so() -> None:
    closed = {**CAR, "additionalProperties": False}
    assert [*faults({"name": "a", "speeds": [1], "wings": 2}, closed)] == ["wings is unknown"]
    by_track = {"type": "object", "propertyNames": {"pattern": r"^\d+$"}, "additionalProperties": SHARE}
    assert [*faults({"7": 0.5}, by_track)] == []
    assert [*faults({"x": 0.5}, by_track)] == ["the name 'x' is \"x\", needs the pattern ^\\d+$"]
    assert [*faults({"7": 2}, by_track)] == ["7 is 2, needs at most 1"]


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "a/b", "a\\b", "a\0"])
def test_a_name_leads_into_no_other_folder(name: str) -> None:
    assert [*faults(name, PLAIN_NAME)] and not [*faults("k733_t60.0", PLAIN_NAME)]


@pytest.mark.parametrize("text", ["", "{", "[" * 10**5, "{" + '"a":{' * 10**4, "\x00", "1" * 10**5])
def test_no_text_is_more_than_one_line(text: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError):
        parse_json(text, CAR)
    (tmp_path / "car.json").write_text(text)
    with pytest.raises(ResultError, match=r"car\.json: .*; make it again") as error:
        read_json(tmp_path / "car.json", CAR, "make it again")
    assert len(str(error.value)) < 500


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="cannot be read: Is a directory; make it again"):
        read_json(tmp_path, CAR, "make it again")
