"""The picture of what attention does: files, and what they are refused for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.learned.training.attention import plot_attention
from scex_sumo.scene import SeedScene
from tests.behaviors import roads
from tests.learned import nets

ROAD = roads.fork()


@pytest.fixture
def scene() -> SeedScene:
    return replace(roads.scene_of((8.0, 0.3, 0.02, 6.0), (30.0, -0.2, 0.0, 5.0)), road=ROAD)


@pytest.mark.parametrize("head", ["bounded", "free"])
def test_a_scene_is_drawn_with_the_plans_of_all_weights(tmp_path: Path, scene: SeedScene, head: str) -> None:
    weights = nets.untrained(tmp_path, "graph_image_predictor", scene, ROAD)
    drawn = plot_attention(scene, tmp_path / "attention.svg", weights=weights, values=(0, 0.4, 1), head=head)
    text = drawn.read_text()
    assert all(f"w = {w}" in text for w in ("0", "0.4", "1"))


def test_without_a_road_or_without_weights_to_try_there_is_nothing_to_draw(
    tmp_path: Path, scene: SeedScene
) -> None:
    with pytest.raises(UsageError, match="the scene has no road"):
        plot_attention(replace(scene, road=None), tmp_path / "a.png")
    with pytest.raises(UsageError, match="values: got none"):
        plot_attention(scene, tmp_path / "a.png", values=())
