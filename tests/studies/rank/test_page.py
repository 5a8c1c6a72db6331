"""Page of a ranking."""

from __future__ import annotations

import pyarrow as pa
import pytest

from scex_sumo.page.html import element
from scex_sumo.studies.rank.page import _lists, glance
from tests.studies.moments.pairs import moment_ref, pairs_table


@pytest.mark.parametrize(
    ("by", "said"), [("probability", "P of a contact between people"), ("gap_m", "gap_m")]
)
def test_the_page_says_by_what_encounters_are_sorted(by: str, said: str) -> None:
    row = {"rank": 1, "to_test": True}
    (section,) = _lists(pa.Table.from_pylist([row]), [(row, element("p", "a card"))], by)
    assert "To be tested: 1" in str(section) and f"Sorted by {said}." in str(section)


@pytest.mark.parametrize("count", [9, 10])
def test_the_time_line_of_a_site_with_ten_moments_has_its_usual_level(count: int) -> None:
    pairs = [(moment_ref(f"r_t{k}.0"), pairs_table((1, 2))) for k in range(count)]
    text = str(glance(pairs, {}, {}, {}))
    assert text.count("area soft") == text.count("band: where most moments of the site are") == (count == 10)
