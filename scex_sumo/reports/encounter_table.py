"""Terminal tables of the encounters of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np
import pyarrow as pa
from rich.console import Console

from scex_sumo.certainty.tables import InfluenceTable
from scex_sumo.reports.encounter_rows import Meeting, meetings
from scex_sumo.reports.run_table import Head, console_table, counted, print_line, print_table
from scex_sumo.results.exact import EVENTS, Encounter, Exact, TooFewFuturesError
from scex_sumo.results.outcomes import collided
from scex_sumo.results.region import EVERYWHERE, Region
from scex_sumo.results.run import Run

QUESTIONS = {
    "collision": "collision",
    "ttc": "TTC on path < 1.5 s",
    "pet": "PET < 1 s",
    "drac": "DRAC > 3.4 m/s²",
    "critical": "any of these",
}
"""Questions about a pair, by column."""
_SHARE = "Share of the futures; a click on a row shows the typical one"
HEADS: Final[tuple[Head, ...]] = (
    ("pair", "names", "A vehicle hits or follows → another"),
    ("place", "names", ""),
    ("futures", "names", "Stress test: driven as any of the models; human-like: as people were recorded"),
    ("collides", "percent", _SHARE),
    ("95 %", "text", "Interval of P(collision)"),
    *((q.upper(), "percent", f"{QUESTIONS[q]}. {_SHARE}") for q in ("ttc", "pet", "drac")),
    ("any", "percent", f"Any of these. {_SHARE}"),
    ("gap", "metres", "Least gap in the typical future; up to 10 m"),
    ("after", "seconds", "Time of the encounter in the typical future"),
    ("driven by", "words", "Models in the typical future"),
)
"""Columns of encounters in the terminal; the page has them too."""


def print_encounters(run: Run, console: Console, *, most: int, region: Region = EVERYWHERE) -> None:
    """Print at most ``most`` lines of both sets of futures, the most critical pair first."""
    scene, found = run.info["seed_scene"]["name"], meetings(run, region)
    indices = None if region == EVERYWHERE else region.vehicles(run.scene)
    if indices is not None:
        inside = run.scene.track_ids[list(indices)].tolist()
        line = (
            f"{len(inside)} of {run.scene.vehicles} vehicles are {region.words()}; one of them collides in "
        )
        likely = run.reference
        human = "" if likely is None else f", {_share(likely, inside)} of the human-like ones"
        print_line(f"{line}{_share(run, inside)} of the futures{human}", console)
    pairs = counted(len({one.pair for one in found}), "pair")
    human = f" and {run.reference.children} human-like ones" if run.reference is not None else ""
    title = f"{scene}: {pairs} of vehicles meet in {counted(run.children, 'future')}{human}"
    caption = (
        "→: hits or follows; shares: of the line's futures; no human-like line: critical in none\n"
        "gap (–: over 10 m), after, driven by: of the typical future, as view --encounter shows it"
    )
    rows = [encounter_cells(one) for one in found[:most]]
    print_table(console_table(title, HEADS, rows, caption=caption), console)


def encounter_cells(one: Meeting) -> list[Any]:
    """Return the cells of an encounter under `HEADS`; probabilities are exact where there is a table."""
    row, found = one.row, Encounter(row=one.row, run=one.run)
    interval = f"{100 * row['collision_low']:.0f}–{100 * row['collision_high']:.0f} %"
    return [
        f"{row['track_id']} → {row['other_id']}",
        row["place"],
        one.futures,
        found.probability(),
        interval if found.table is None else "exact",
        *(found.probability(name) for name in ("ttc", "pet", "drac", "critical")),
        row["gap"],
        round(row["time_s"], 1),
        f"{row['model']}, {row['other_model']}",
    ]


def _share(run: Run, vehicles: Sequence[int]) -> str:
    """Return the share of the futures in which one of these vehicles collides."""
    hits = run.collisions
    own = np.isin([np.asarray(hits["track_id"]), np.asarray(hits["other_id"])], vehicles).any(axis=0)
    return run.intervals.share(collided(hits.filter(pa.array(own)), np.arange(run.children))).percent


def print_pair(one: Meeting, console: Console) -> None:
    """Print shares, gaps, models and colliding futures of a pair in one set of futures."""
    run, row = one.run, one.row
    print_line(one.words(), console)
    found, rows = Encounter(row=row, run=run), []
    for name, words in QUESTIONS.items():
        events = EVENTS if name == "critical" else (name,)
        is_exact = all(found.table_of(event) is not None for event in events)
        sure = "exact" if is_exact else f"{row[f'{name}_low']:.1%} – {row[f'{name}_high']:.1%}"
        rows.append((words, found.probability(name) if is_exact else row[name], sure))
    heads = [("question", "names", ""), ("share", "percent", ""), ("interval", "text", "")]
    title = f"share of {run.children} {one.futures} futures, 95 % interval"
    print_table(console_table(title, heads, rows), console)
    if run.exact is not None and found.table is not None and found.probability() > 0:
        _print_exact(run.exact, found.table, console)
    gaps = ["> 10" if row[f"gap_p{p}"] is None else f"{row[f'gap_p{p}']:.1f}" for p in ("05", "50", "95")]
    print_line(
        f"least gap in m: {gaps[0]} in 5 %, {gaps[1]} in 50 %, {gaps[2]} in 95 % of the futures", console
    )
    if row["models"]:
        heads = [(str(row[name]), "names", "") for name in ("track_id", "other_id")]
        heads += [(name, "text", "") for name in ("futures", "critical")]
        heads += [("P", "percent", ""), ("of all", "percent", ""), ("lift", "real", "")]
        print_table(
            console_table("by their models", heads, [list(e.values()) for e in row["models"]]), console
        )
    hits = np.flatnonzero(found.happens("collision")).tolist()
    if hits:
        shown = ", ".join(map(str, hits[:12])) + (", ..." if len(hits) > 12 else "")
        print_line(f"collides in futures {shown}", console)
    look = f"look: scex-sumo view {run.folder} --encounter {row['track_id']},{row['other_id']}"
    console.print(look, soft_wrap=True, highlight=False)


def _print_exact(exact: Exact, table: InfluenceTable, console: Console) -> None:
    """Print the cut sets of a collision, and whose models matter how much."""
    print_line(f"collides exactly if ({exact.told()}):", console)
    for words in table.in_words():
        print_line(f"  {words}", console)
    for track, models in table.leverage().items():
        most = max(models, key=lambda model: abs(models[model]))
        print_line(f"  {track}: P changes by {models[most]:+.3f} per share of {most}", console)


def print_weights(run: Run, weights: Mapping[str, float], console: Console, *, most: int = 20) -> None:
    """Print the probabilities of the critical pairs with other weights of the models.

    Raises:
        UsageError: a model is unknown, or a weight is below 0.
    """
    given = ", ".join(f"{model} {weight:g}" for model, weight in weights.items())
    heads: list[Head] = [("pair", "names", ""), *((QUESTIONS[event], "text", "") for event in EVENTS)]
    pairs, sampled = [row for row in run.encounters.to_pylist() if row["critical"] > 0], False
    rows = []
    for row in pairs[:most]:
        found = Encounter(row=row, run=run)
        marks = {event: "" if found.table_of(event) is not None else "~" for event in EVENTS}
        sampled |= "~" in marks.values()
        cells = [
            f"{mark}{found.probability(event):.2%} → {'–' if new is None else f'{new:.2%}'}"
            for (event, new), mark in zip(found.weighted(weights).items(), marks.values(), strict=True)
        ]
        rows.append([f"{row['track_id']} → {row['other_id']}", *cells])
    new = "–"
    with suppress(TooFewFuturesError):
        new = f"{run.p_collision(weights):.2%}"
    mark = "" if run.p_collision.exact is not None else "~"
    rows.append(["any", f"{mark}{run.p_collision():.2%} → {new}", *[""] * (len(EVENTS) - 1)])
    print_table(console_table(f"P with {given} instead of the run's weights", heads, rows), console)
    if sampled or mark:
        print_line("~ from the drawn futures, weighted; – too few of them are driven like this", console)
    if len(pairs) > most:
        print_line(f"{len(pairs) - most} more pairs with --most", console)
