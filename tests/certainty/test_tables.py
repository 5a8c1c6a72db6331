"""Influence tables: probabilities, leverage, cut sets and unions, by hand and against enumeration."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.results import Exact
from scex_sumo.certainty.tables import Draws, InfluenceTable, reduced, union_probability

MODELS = ("calm", "hasty", "emergency_brake")


def table(
    *tracks: int, happens: set[tuple[int, ...]], shares: tuple[float, ...] = (0.5, 0.3, 0.2)
) -> InfluenceTable:
    outcomes = np.zeros((3,) * len(tracks), dtype=bool)
    for cell in happens:
        outcomes[cell] = True
    return InfluenceTable(
        track_ids=tracks, draws=Draws(models=MODELS, shares=np.array(shares)), outcomes=outcomes, checked=300
    )


HIT = table(7, 11, happens={(1, 2), (2, 2)})


def test_the_probability_is_the_sum_over_the_cells() -> None:
    assert HIT.probability() == pytest.approx((0.3 + 0.2) * 0.2)
    assert HIT.remainder == pytest.approx(0.01)


def test_other_weights_need_no_new_futures() -> None:
    assert HIT.probability({"emergency_brake": 0.5}) == pytest.approx((0.5 * 0.3 / 0.8 + 0.5) * 0.5)
    only = HIT.probability({11: {"emergency_brake": 1.0}, 7: {"calm": 1, "hasty": 1, "emergency_brake": 2}})
    assert only == pytest.approx(0.75)
    for weights, words in (({"none": 1.0}, "unknown model 'none'"), ({"calm": -1.0}, "0 or more")):
        with pytest.raises(UsageError, match=words):
            HIT.probability(weights)
    with pytest.raises(UsageError, match="all are 0"):
        HIT.probability(dict.fromkeys(MODELS, 0.0))


def test_leverage_is_the_derivative() -> None:
    """Vehicle 11: P = 0.5 s, and the share s of its emergency brake is moved from the others."""
    found = HIT.leverage()
    assert found[11]["emergency_brake"] == pytest.approx(0.5)
    step = 1e-6
    more = HIT.probability({7: {"hasty": 0.3 + step}})
    assert found[7]["hasty"] == pytest.approx((more - HIT.probability()) / step, rel=1e-4)


def test_cut_sets_are_minimal_and_read_as_words() -> None:
    assert set(HIT.cut_sets) == {frozenset({(7, 1), (11, 2)}), frozenset({(7, 2), (11, 2)})}
    assert HIT.in_words() == ["7 does not drive as calm and 11 brakes hard (emergency_brake)"]
    others = table(7, 11, happens={(k, j) for k in (0, 1) for j in (0, 1)})
    assert others.in_words() == ["7 does not brake hard and 11 does not brake hard"]
    # Whatever vehicle 7 does: one set with vehicle 11 alone.
    assert table(7, 11, happens={(k, 2) for k in range(3)}).cut_sets == (frozenset({(11, 2)}),)
    always = table(happens={()})
    assert always.cut_sets == (frozenset(),) and always.in_words() == ["whatever its drivers do"]


def test_a_vehicle_without_influence_is_dropped() -> None:
    small = reduced(table(7, 9, 11, happens={(1, k, 2) for k in range(3)}))
    assert small.track_ids == (7, 11) and small.probability() == pytest.approx(0.06)


def test_unions_of_apart_events_multiply_and_of_connected_ones_are_enumerated() -> None:
    apart = [HIT, table(1, 2, happens={(0, 0)})]
    assert union_probability(apart) == pytest.approx(1 - (1 - 0.1) * (1 - 0.25))
    rng = np.random.default_rng(1)
    chain = [
        table(k, k + 1, happens={cell for cell in product(range(3), repeat=2) if rng.random() < 0.3})
        for k in range(5)
    ]
    shares, total = np.array([0.5, 0.3, 0.2]), 0.0
    for cell in product(range(3), repeat=6):
        if any(one.outcomes[cell[one.track_ids[0]], cell[one.track_ids[1]]] for one in chain):
            total += float(np.prod(shares[list(cell)]))
    assert union_probability(chain) == pytest.approx(total, abs=1e-12)
    assert union_probability([]) == 0.0


def test_the_table_that_fewest_futures_checked_tells_how_sure_the_answer_is() -> None:
    tables = {(7, 11, "collision"): replace(HIT, checked=96), (7, 11, "drac"): replace(HIT, checked=10)}
    shares = {"draws": HIT.draws, "sampled": {}, "checked": 385, "extra": 100}
    assert "checked on 96 futures: none differs (remainder 3.1%)" in Exact(tables=tables, **shares).summary()
    assert "checked on 385 futures" in Exact(tables={}, **shares).summary()


def test_people_draw_models_of_their_own() -> None:
    draws = Draws(
        models=("calm", "hasty", "stops", "steps_out"),
        shares=np.array([0.6, 0.4, 0.75, 0.25]),
        people=frozenset({9}),
        of_people=frozenset({"stops", "steps_out"}),
    )
    one = InfluenceTable.of_cubes([{7: 1, 9: 3}, {7: 0, 9: 2}, {7: 0, 9: 3}], (7, 9), draws, 300)
    assert one.probability() == pytest.approx(0.6 + 0.4 * 0.25)
    # Whatever the person does: its models alone count.
    assert set(one.cut_sets) == {frozenset({(7, 0)}), frozenset({(9, 3)})}
    assert one.in_words() == ["7 drives as calm", "9 steps out (steps_out)"]
    assert one.probability({"calm": 0.0}) == pytest.approx(0.25)  # of vehicles alone
    assert one.probability({9: {"steps_out": 1.0}}) == 1.0
    assert one.leverage()[9] == pytest.approx({"stops": -0.4, "steps_out": 0.4})
    with pytest.raises(UsageError, match="unknown model 'calm'"):
        one.probability({9: {"calm": 1.0}})
    crossing = InfluenceTable.of_cubes([{7: 1, 9: 3}], (7, 9), draws, 300)
    assert union_probability([one, crossing]) == pytest.approx(one.probability())
