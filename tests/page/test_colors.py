"""Colours of pages: contrast as WCAG 2.1 AA asks, people and the stress test different in grey."""

from __future__ import annotations

import re

import pytest

from scex_sumo.page.html import asset

TEXTS = ("ink", "soft", "accent", "drawn", "likely", "critical", "picked")
GROUNDS = ("ground", "card", "map")
AA = 4.5  # of texts
APART = 2.0  # of lines and bars that are told apart


ROOTS = re.findall(r":root {(.*?)}", asset("page.css"), re.DOTALL)[:2]  # light, dark
PALETTES = [dict(re.findall(r"--(\w+): (#\w+)", root)) for root in ROOTS]


def luminance(color: str) -> float:
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_the_guideline() -> None:
    assert contrast("#fff", "#000000") == pytest.approx(21.0)
    assert contrast("#767676", "#fff") == pytest.approx(4.54, abs=0.01)


@pytest.mark.parametrize("palette", PALETTES, ids=["light", "dark"])
def test_texts_have_contrast_and_sets_differ_in_grey(palette: dict[str, str]) -> None:
    poor = {
        (text, ground): round(found, 2)
        for text in TEXTS
        for ground in GROUNDS
        if (found := contrast(palette[text], palette[ground])) < AA
    }
    assert poor == {}
    assert contrast(palette["drawn"], palette["likely"]) > APART
