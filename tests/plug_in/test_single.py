"""Single-vehicle models see the map around their vehicle."""

from __future__ import annotations

from scex_sumo.plug_in.user_model import narrow_road
from tests.behaviors import roads


def test_the_map_can_be_narrowed_to_what_is_near() -> None:
    fork = roads.fork()
    assert sorted(narrow_road(fork, 0.0, 0.0, 10.0).lanes) == [1]
    assert sorted(narrow_road(fork, 50.0, 0.0, 5.0).lanes) == [1, 11, 12, 13]
