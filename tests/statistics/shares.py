"""Wilson's interval of a share of whole trials."""

from __future__ import annotations

from scex_sumo.statistics.density import Interval, wilson_of


def wilson(successes: int, count: int) -> Interval:
    """The share of successes with its score interval (Wilson 1927)."""
    low, high = wilson_of(successes / count, count)
    return Interval(value=successes / count, low=low, high=high, count=count)
