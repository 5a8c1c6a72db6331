"""Page of a ranking."""

from __future__ import annotations

import pyarrow as pa
import pytest

from scex_sumo.page.html import element
from scex_sumo.studies.rank.page import _lists


@pytest.mark.parametrize(
    ("by", "said"), [("probability", "P of a contact between people"), ("gap_m", "gap_m")]
)
def test_the_page_says_by_what_encounters_are_sorted(by: str, said: str) -> None:
    row = {"rank": 1, "to_test": True}
    (section,) = _lists(pa.Table.from_pylist([row]), [(row, element("p", "a card"))], by)
    assert "To be tested: 1" in str(section) and f"Sorted by {said}." in str(section)
