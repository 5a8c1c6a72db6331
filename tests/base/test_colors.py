"""Models keep their colours from run to run, and share none within one."""

from __future__ import annotations

from scex_sumo.base.colors import model_colors


def test_models_keep_their_colours() -> None:
    assert model_colors(["risky_driver", "mine"]) == model_colors(["risky_driver:time_headway=1", "mine:a=2"])
    assert len(set(model_colors(["mine", "yours", "sumo:EIDM", "standard_driver"]))) == 4


def test_models_have_colours_of_their_own() -> None:
    colors = model_colors(["standard_driver", "mine", "standard_driver:politeness=0", "replay"])
    assert len(set(colors)) == 4
