"""Groups of runs: trees by hand, silhouettes and indices from their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.compare.compare import group_runs, silhouette


def line(*places: float) -> np.ndarray:
    at = np.array(places)
    return np.abs(at[:, None] - at)


def test_two_clumps_are_two_groups() -> None:
    grouping = group_runs(line(0.0, 10.0, 0.1, 10.1, 0.2), list("abcde"))
    assert grouping.groups == 2
    assert grouping.group[0] == grouping.group[2] == grouping.group[4]
    assert grouping.group[1] == grouping.group[3] != grouping.group[0]
    # The leaves of a group lie side by side, and groups are numbered along them.
    assert grouping.group[grouping.order].tolist() in ([1, 1, 1, 2, 2], [1, 1, 2, 2, 2])


def test_heights_are_in_units_of_the_distance() -> None:
    # 0 and 1 join at their distance of 1. Then 4: distances are squared lengths, the middle of 0 and 1 is
    # (4 + 3) / 2 - 1 / 4 away from 4, and Ward's factor is 2 * 2 * 1 / 3.
    grouping = group_runs(line(0.0, 1.0, 4.0), list("abc"))
    np.testing.assert_allclose(grouping.linkage[:, 2], [1.0, 4 / 3 * (3.5 - 0.25)], rtol=1e-12)
    assert sorted(grouping.linkage[0, :2]) == [0, 1]


@given(st.lists(st.integers(0, 60), min_size=3, max_size=9, unique=True), st.randoms(use_true_random=False))
def test_the_order_of_the_runs_does_not_matter(places: list[int], random: object) -> None:
    order = list(range(len(places)))
    random.shuffle(order)  # type: ignore[attr-defined]
    labels = [f"r{p}" for p in places]
    straight = group_runs(line(*places), labels)
    shuffled = group_runs(line(*[places[o] for o in order]), [labels[o] for o in order])
    assert shuffled.group.tolist() == straight.group[order].tolist()
    assert [labels[o] for o in straight.order] == [labels[order[o]] for o in shuffled.order]


def test_the_number_of_groups_is_the_users_where_given() -> None:
    distance = line(0.0, 1.0, 5.0, 6.0)
    assert group_runs(distance, list("abcd"), groups=1).group.tolist() == [1, 1, 1, 1]
    assert sorted(group_runs(distance, list("abcd"), groups=4).group.tolist()) == [1, 2, 3, 4]
    for groups in (0, 5):
        with pytest.raises(UsageError, match=f"--groups: got {groups}, needs 1 to 4"):
            group_runs(distance, list("abcd"), groups=groups)


def test_two_runs_and_equal_runs_make_groups_too() -> None:
    assert sorted(group_runs(line(0.0, 1.0), ["a", "b"]).group.tolist()) == [1, 2]
    assert len(group_runs(np.zeros((3, 3)), ["a", "b", "c"]).order) == 3


def test_the_silhouette_is_its_definition() -> None:
    # 0: own group 1 away, the other (9 + 11) / 2 = 10: (10 - 1) / 10. 1: 1 and 9. 9: 2 and 8.5.
    # 11: 2 and 10.5.
    fit = silhouette(line(0.0, 1.0, 9.0, 11.0), ["a", "a", "b", "b"])
    np.testing.assert_allclose(fit, [9 / 10, 8 / 9, 6.5 / 8.5, 8.5 / 10.5], rtol=1e-12)
    np.testing.assert_array_equal(silhouette(line(0.0, 1.0), ["a", "b"]), [0.0, 0.0])
    np.testing.assert_array_equal(silhouette(line(0.0, 1.0), ["a", "a"]), [0.0, 0.0])
