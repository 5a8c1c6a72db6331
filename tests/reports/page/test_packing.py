"""What is packed comes out as it went in, in the smallest type, and differences add up."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.reports.page.packing import pack, quantized, second_differences, second_sums, smallest
from tests.reports.page.packed import unpack


def test_arrays_and_words_come_out_as_they_went_in() -> None:
    arrays = {
        "small": np.array([[1, -2], [3, 127]]),
        "wide": np.array([40_000, -70_000]),
        "none": np.zeros((0, 3), dtype=np.int64),
        "real": np.array([0.5, np.inf, np.nan]),
    }
    info, found = unpack(pack({"name": "größer", "limit": None}, arrays))
    assert info == {"name": "größer", "limit": None}
    for name, values in arrays.items():
        np.testing.assert_array_equal(found[name], values)


def test_what_json_does_not_know_becomes_null_or_words() -> None:
    known = {"whole": np.int64(3), "real": np.float64(0.5), "pair": (1, 2.5)}
    assert unpack(pack(known, {}))[0] == {"whole": "3", "real": 0.5, "pair": [1, 2.5]}
    endless = {**known, "most": np.inf, "deep": [{"least": -np.inf}, np.nan]}
    plain = {"whole": "3", "real": 0.5, "pair": [1, 2.5], "most": None, "deep": [{"least": None}, None]}
    assert unpack(pack(endless, {}))[0] == plain


@pytest.mark.parametrize(("value", "size"), [(127, 1), (-128, 1), (128, 2), (-32_769, 4)])
def test_integers_take_as_few_bytes_as_they_need(value: int, size: int) -> None:
    assert smallest(np.array([value])).itemsize == size


def test_steady_motion_has_no_second_differences() -> None:
    steady = 5 + 3 * np.arange(1, 6)[None, :, None]
    differences = second_differences(steady)
    assert (differences[:, 2:] == 0).all()
    np.testing.assert_array_equal(second_sums(differences), steady)


def test_values_are_rounded_to_the_nearest_unit() -> None:
    assert quantized(np.array([0.014, -0.016]), 0.01).tolist() == [1, -2]
