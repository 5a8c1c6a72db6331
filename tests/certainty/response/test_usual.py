"""What is usual: the median of the class with the encounter itself, and its place by P."""

import numpy as np
import pytest

from scex_sumo.certainty.response.usual import Usual, ordinal, usual_in


def test_an_encounter_is_one_of_its_class() -> None:
    found = usual_in(np.array([1e-5, 3e-5, 2e-4]), 3e-4, "at this site")
    assert found == Usual(median=pytest.approx(1.15e-4), rank=1, of=4, what="at this site")  # type: ignore[arg-type]


def test_equal_encounters_share_the_better_place() -> None:
    assert usual_in(np.array([1e-4, 1e-4, 2e-4]), 1e-4, "").rank == 2


def test_times_the_median_have_one_digit() -> None:
    usual = Usual(median=1e-5, rank=2, of=148, what="at this site")
    assert usual.words(2.96e-4) == "30 × the median at this site, 2nd of 148"
    assert usual.words(0.113) == "10 000 × the median at this site, 2nd of 148"
    assert usual.words(4e-6) == "0.4 × the median at this site, 2nd of 148"


@pytest.mark.parametrize(
    ("number", "words"), [(1, "1st"), (3, "3rd"), (11, "11th"), (22, "22nd"), (112, "112th")]
)
def test_ordinals(number: int, words: str) -> None:
    assert ordinal(number) == words
