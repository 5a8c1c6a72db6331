"""Probabilities of encounters with other weights of the models, without new futures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from rich.console import Console

from scex_sumo.certainty.results import TooFewFuturesError, exact_of, weighted_probability
from scex_sumo.certainty.tables import Weights
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.reports.encounter_rows import STRESS_TEST, Meeting
from scex_sumo.reports.run_table import Head, console_table, print_line, print_table
from scex_sumo.results.extras import known_percent
from scex_sumo.results.probability import Probability
from scex_sumo.results.run import Run


def weighted(run: Run, pair: tuple[int, int], weights: Weights) -> dict[str, float | None]:
    """Return the probability of each event of a pair; None for too few futures that are driven like this."""
    probabilities: dict[str, float | None] = {}
    for event in EVENTS:
        probabilities[event] = None
        with suppress(TooFewFuturesError):
            probabilities[event] = weighted_probability(run, weights, event, pair)
    return probabilities


def weighted_rows(
    run: Run, encounters: Sequence[Meeting], rows: Sequence[dict[str, Any]], weights: Weights
) -> list[dict[str, Any]]:
    """Return the rows of ``encounters --json`` with ``weighted`` probabilities of the stress test."""
    exact = exact_of(run)
    return [
        row
        if one.futures != STRESS_TEST
        else row
        | {
            "exact_collision": None if exact is None else exact.probability(COLLISION, one.pair, weights),
            "weighted": weighted(run, one.pair, weights),
        }
        for one, row in zip(encounters, rows, strict=True)
    ]


def print_weights(run: Run, weights: Mapping[str, float], console: Console, *, most: int = 20) -> None:
    """Print the probabilities of the critical pairs with other weights of the models.

    Raises:
        UsageError: a model is unknown, or a weight is below 0.
    """
    given = ", ".join(f"{model} {weight:.3g}" for model, weight in weights.items())
    heads: list[Head] = [("pair", "names", ""), *((event.question, "text", "") for event in EVENTS.values())]
    pairs, sampled = [row for row in run.encounters.to_pylist() if row["critical"] > 0], False
    rows = []
    for row in pairs[:most]:
        encounter = run.encounter(row["track_id"], row["other_id"])
        before = {event: encounter.probability(event) for event in EVENTS}
        sampled |= any(share.exact is None for share in before.values())
        after = weighted(run, encounter.pair, weights)
        cells = [f"{_marked(share)} → {_percent(after[event], share)}" for event, share in before.items()]
        rows.append([f"{row['track_id']} → {row['other_id']}", *cells])
    any_one, new = run.collision, None
    with suppress(TooFewFuturesError):
        new = weighted_probability(run, weights)
    rows.append(["any", f"{_marked(any_one)} → {_percent(new, any_one)}", *[""] * (len(EVENTS) - 1)])
    print_table(console_table(f"P with {given} instead of the run's weights", heads, rows), console)
    if sampled or any_one.exact is None:
        print_line("~ from the drawn futures, weighted; – too few of them are driven like this", console)
    if len(pairs) > most:
        print_line(f"{len(pairs) - most} more pairs with --most", console)


def _marked(share: Probability) -> str:
    return f"{'~' if share.exact is None else ''}{share.percent}"


def _percent(share: float | None, before: Probability) -> str:
    """Return a share in percent, with the digits that the run's own one has."""
    sampled = before.sampled.high - before.sampled.low
    return "–" if share is None else known_percent(share, before.known.remainder if before.known else sampled)
