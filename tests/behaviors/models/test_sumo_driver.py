"""SUMO's own drivers: routes for the world, a planned path for the metrics."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.models.sumo import SumoDriver
from tests.behaviors import roads


def test_without_a_choice_the_route_goes_straight_on_whatever_the_draw() -> None:
    scene = roads.scene_of((20.0, 0.0, 0.0, 10.0))
    routes = SumoDriver("EIDM").routes(scene, roads.fork(), np.array([0, 0]), np.array([0.1, 0.9]))
    assert routes == [(1, 12), (1, 12)]


def test_a_route_goes_on_beyond_the_fork_for_half_a_kilometre() -> None:
    last = 8
    chain = roads.road(
        *(
            roads.lane(
                i,
                [(100.0 * i, 0.0), (100.0 * i + 100.0, 0.0)],
                successors=(i + 1,) if i < last else (),
                predecessors=(i - 1,) if i else (),
            )
            for i in range(last + 1)
        )
    )
    scene = roads.scene_of((20.0, 0.0, 0.0, 10.0))
    (route,) = SumoDriver("EIDM").routes(scene, chain, np.array([0]), np.array([0.5]))
    assert route == (0, 1, 2, 3, 4)


def test_unknown_models_and_parameters_are_refused() -> None:
    with pytest.raises(UsageError, match="unknown SUMO model 'Fast'"):
        SumoDriver("Fast")
    with pytest.raises(UsageError, match="unknown parameter 'colour'"):
        SumoDriver("EIDM", {"colour": "1"})
