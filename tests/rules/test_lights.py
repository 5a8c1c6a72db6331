"""Bars of lights stand at the ends of lanes and show what the programme says at each step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.rules.lights import light_bars
from tests.rules.test_net import LOGIC, NET


def net_of(folder: Path, *, offset: str = "0.1", programme: str = "recorded") -> Path:
    words = {"LOGIC": LOGIC, "FIRST": "00", "LIGHT": 'tl="t" linkIndex="0"', "OFFSET": offset}
    text = NET
    for word, value in (words | {"PROGRAMME": programme}).items():
        text = text.replace(word, value)
    path = folder / "lit.net.xml"
    path.write_text(text)
    return path


def test_a_bar_lies_across_the_end_of_its_lane(tmp_path: Path) -> None:
    (bar,) = light_bars(net_of(tmp_path), 3, known=False)
    assert np.sort(bar.ends[:, 1]) == pytest.approx([-1.6, 1.6])
    assert bar.ends[:, 0] == pytest.approx([0, 0])
