"""Rules of the road as JSON: passages, lines and crosswalks of a map, and the lights of one moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Final

import numpy as np

from scex_sumo.base.schema import COUNT, NUMBER, TEXT, TRACK, listed, record
from scex_sumo.road import Passage, Rules, Signal

_LINE = listed(listed(NUMBER, 2, 2), 2)
_PASSAGE = record(
    {
        **{"line": _LINE, "lanes": listed(TRACK, 1), "state": TEXT, "yields_to": listed(COUNT)},
        "signal": {"type": "integer", "minimum": -1},
    }
)
_LINES = dict.fromkeys(("stop_lines", "crosswalks"), listed(_LINE))
RULES: Final = record({"passages": listed(_PASSAGE), **_LINES})
LIGHTS: Final = listed(record({"letters": TEXT, "ends_s": listed(NUMBER), "start_s": NUMBER}))


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
    """Return the rules of `rules_to_json`, of the schema `RULES`, with lights of `LIGHTS`.

    Raises:
        ValueError: they do not fit each other.
    """
    passages, tuples = content["passages"], ("lanes", "yields_to")
    others = max((k for one in passages for k in one["yields_to"]), default=-1)
    if others >= len(passages) or max((one["signal"] for one in passages), default=-1) >= len(lights):
        raise ValueError("a passage names a passage or a light that is not there")
    for one in lights:
        ends = [0.0, *one["ends_s"]]
        if ends != sorted({*ends}) or len(one["letters"]) != len(one["ends_s"]):
            raise ValueError("a light has not one end for each phase, one after the other")
    names = {kind: [field.name for field in fields(kind)] for kind in (Passage, Signal)}
    passages = [{name: one[name] for name in names[Passage]} for one in passages]
    signals = [{name: one[name] for name in names[Signal]} for one in lights]
    return Rules(
        passages=tuple(
            Passage(**{**one, "line": np.array(one["line"]), **{name: tuple(one[name]) for name in tuples}})
            for one in passages
        ),
        signals=tuple(Signal(**{**one, "ends_s": np.array(one["ends_s"])}) for one in signals),
        stop_lines=tuple(np.array(line) for line in content["stop_lines"]),
        crosswalks=tuple(np.array(outline) for outline in content["crosswalks"]),
    )
