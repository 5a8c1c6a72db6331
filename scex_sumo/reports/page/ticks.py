"""Ticks of an axis: round numbers that have room."""

from __future__ import annotations

import math

_ROUND = (1, 2, 5, 10)


def ticks(low: float, high: float, most: int = 4) -> list[tuple[float, str]]:
    """Round numbers within a range, with what is written for each.

    Args:
        low: where the axis begins.
        high: where it ends, above ``low``.
        most: about how many steps it is to have.
    """
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in _ROUND if power * factor >= raw * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(number * step, f"{number * step:.{digits}f}") for number in numbers]
