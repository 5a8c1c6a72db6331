"""Rules of the road as JSON: passages, lines and crosswalks of a map, and the lights of one moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scex_sumo.road import Passage, Rules, Signal


def rules_to_json(rules: Rules) -> dict[str, Any]:
    """Return rules without their lights."""
    return {
        "passages": [_plain(one) for one in rules.passages],
        "stop_lines": [line.tolist() for line in rules.stop_lines],
        "crosswalks": [outline.tolist() for outline in rules.crosswalks],
    }


def lights_to_json(rules: Rules) -> list[dict[str, Any]]:
    """Return the lights of rules; one without letters is unknown."""
    return [_plain(one) for one in rules.signals]


def _plain(one: Passage | Signal) -> dict[str, Any]:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(one).items()}


def rules_of_json(content: Mapping[str, Any], lights: Sequence[Mapping[str, Any]]) -> Rules:
    """Return the rules of `rules_to_json` with lights of `lights_to_json`."""
    tuples = ("lanes", "yields_to")
    return Rules(
        passages=tuple(
            Passage(**{**one, "line": np.array(one["line"]), **{name: tuple(one[name]) for name in tuples}})
            for one in content["passages"]
        ),
        signals=tuple(Signal(**{**one, "ends_s": np.array(one["ends_s"])}) for one in lights),
        stop_lines=tuple(np.array(line) for line in content["stop_lines"]),
        crosswalks=tuple(np.array(outline) for outline in content["crosswalks"]),
    )
