"""The answer of a run on one card of at most 14 lines, which the page shows, too."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.reports.encounter_rows import driven_as, worst_stress
from scex_sumo.reports.words import MAIN, counted, extra_rows, participants, row_cell
from scex_sumo.results.decision import DISAGREE, DOUBTFUL, NOTHING, TEST, VERDICTS
from scex_sumo.results.run import Run
from scex_sumo.results.tables.cut_sets import cut_set_words
from scex_sumo.results.tables.pairs import NARROW, any_of, arrow, once_in, one_in, told_pairs

LINES: Final = 14  # of the answer
COLUMNS: Final = 80
MANY: Final = 10  # vehicles from which one asks for those around one
SATURATED: Final = 0.9  # share of futures with a collision from which it says nothing about the scene
_MOST, _LEAST = 5, 2  # pairs
_FROM_PEOPLE = 3  # pairs of people before those of the stress test
_STYLES: Final[Mapping[str, str]] = {
    TEST: "bold red",
    NOTHING: "bold green",
    DISAGREE: "bold yellow",
    DOUBTFUL: "bold yellow",
}
_HEADS = ("pair", "what happens", "people", "stress test", "after")
_OFTEN = "; people collide "  # where the second line of the verdict begins


@dataclass(frozen=True, kw_only=True)
class PairLine:
    """One pair of the card.

    Attributes:
        label: an arrow from the vehicle that hits or follows to the other one.
        what: kind of the conflict; ``how`` it comes to it, in words.
        people: P of a contact between people; None: below what is told.
        stress: share of the futures of the stress test that collide; None without a stress test.
        after_s: when it happens, after the moment.
        future: that shows it: a human-like one with ``people``, else one of the stress test.
    """

    label: str
    pair: tuple[int, int]
    what: str
    how: str
    people: float | None
    stress: float | None
    after_s: float
    future: int

    @property
    def caption(self) -> str:
        """What happens, and how often, in words."""
        frequency = f"in {percent(self.stress or 0.0)} of the stress test"
        frequency = frequency if self.people is None else f"people collide {once_in(self.people)}"
        return f"{self.label}: {self.how or self.what}; {frequency}"

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Pair, what happens, people, stress test and time, in words."""
        stress = "–" if self.stress is None else percent(self.stress)
        people = "–" if self.people is None else chance(self.people)
        return self.label, self.how or self.what, people, stress, f"{self.after_s:.1f}{NARROW}s"


def percent(share: float) -> str:
    """Return a share in percent: two digits, and none that is not 0 as 0."""
    if 0 < share < 0.005:
        return f"<{NARROW}1{NARROW}%"
    return f"{100 * share:.0f}{NARROW}%"


def chance(probability: float) -> str:
    """Return a probability in a column: one of so many, from a half on in percent."""
    return percent(probability) if probability >= 0.5 else f"1 in {one_in(probability)}".replace(" ", NARROW)


def pair_lines(run: Run) -> list[PairLine]:
    """Return the pairs of the card: those most probable between people, and the worst of the stress test."""
    return sorted(_candidates(run), key=_by_people)


def _by_people(line: PairLine) -> float:
    return -(line.people or 0.0)


def _candidates(run: Run) -> list[PairLine]:
    """Return at most `_MOST` pairs: first that of the verdict, then those that stay on shorter cards."""
    people = {frozenset((row["track_id"], row["other_id"])): row for row in told_pairs(run)}
    stress = {frozenset(meeting.pair): meeting.row for meeting in worst_stress(run)}
    shares = {ids: row["collision"] for ids, row in stress.items() if row["collision"] > 0}
    decided = frozenset((run.decision.pair if run.decision is not None else None) or ())
    chosen = dict.fromkeys([*people.keys() & {decided}, *[*people][:_FROM_PEOPLE], *shares, *people])
    return [
        _line(people[ids] if ids in people else _as_pair(stress[ids]), stress=shares.get(ids, 0.0))
        for ids in [*chosen][:_MOST]
    ]


def _line(pair: Mapping[str, Any], *, stress: float | None) -> PairLine:
    """Return the line of a row of ``pairs.parquet``, or of `_as_pair`."""
    return PairLine(
        label=arrow(pair),
        pair=(pair["track_id"], pair["other_id"]),
        what=pair["what"],
        how=pair["how"] or "",
        people=pair["probability"],
        stress=stress,
        after_s=pair["conflict_s"],
        future=pair["future"],
    )


def _as_pair(encounter: Mapping[str, Any]) -> dict[str, Any]:
    words = cut_set_words(encounter)
    how = f"if {words[0].partition(' in which ')[2]}" if words and " in which " in words[0] else ""
    what = encounter["kind"] or "collision"
    return {**encounter, "what": what, "how": how, "conflict_s": encounter["time_s"], "probability": None}


def decided_line(run: Run) -> PairLine | None:
    """Return the pair of the verdict, also where its data are doubtful; None without one."""
    decision = run.decision
    if decision is None or decision.pair is None or decision.future is None:
        return None
    pair = _decided_pair(run) | {
        "what": decision.what or "",
        "how": decision.doubt or decision.how,
        "conflict_s": decision.time_s or 0.0,
        "future": decision.future,
        "probability": decision.probability,
    }
    return _line(pair, stress=None)


def any_cells(run: Run) -> list[str]:
    """Return the line of any pair, under the heads of `PairLine.cells`."""
    shares = [pair["probability"] for pair in told_pairs(run)]
    saturated = run.collision.value >= SATURATED and not run.info.get("region")
    many = run.info["seed_scene"]["vehicles"] >= MANY
    hint = "one vehicle: --region TRACK" if saturated and many else ""
    return ["any", hint, chance(any_of(shares)) if shares else "–", _collides(run), ""]


def print_card(run: Run, console: Console) -> None:
    """Print the answer on at most `LINES` lines of `COLUMNS` columns."""
    wide = max(min(console.width, 110), COLUMNS) if not console.is_terminal else console.width
    above = [*_wrapped(title(run), wide), *verdict_lines(run, wide)]
    below = [*_doubts(run, wide), *metric_lines(run, wide), *_own_lines(run, wide)]
    closing = 3  # report, look, verdict
    candidates, total = _candidates(run), any_cells(run)
    for most in range(_MOST, _LEAST - 1, -1):
        rows = _table(run, sorted(candidates[:most], key=_by_people), total, wide)
        if len(above) + len(rows) + len(below) + closing <= LINES:
            break
    for line in [*above, *rows, *below]:
        console.print(line, soft_wrap=True)


def print_closing(run: Run, console: Console) -> None:
    """Print the verdict again, as the last line."""
    if (decision := run.decision) is None:
        return
    text = Text(VERDICTS[decision.kind].upper(), style=_STYLES[decision.kind])
    if decision.pair is not None:
        text.append(f"  {arrow(_decided_pair(run))}: {once_in(decision.probability)}", style="default")
    console.print(text, soft_wrap=True)


def title(run: Run) -> str:
    """Return the moment, who takes part, and how many futures there are."""
    scene, human = run.info["seed_scene"], run.reference
    place, _, seconds = scene["name"].rpartition("_t")
    moment = f"{place} at {seconds}{NARROW}s" if place and scene.get("time_s") is not None else scene["name"]
    text = f"{moment}: {participants(scene)}, {counted(run.futures, 'future')}"
    text += f" of {run.info['steps'] / 10:g}{NARROW}s" + (f", {human.futures} human-like" if human else "")
    if region := run.info.get("region"):
        text += f"; only pairs with one of {counted(len(region['vehicles']), 'vehicle')} {region['words']}"
    return text


def verdict_lines(run: Run, wide: int) -> list[Text]:
    """Return the verdict, its pair, how often and the limit, in words."""
    decision = run.decision
    if decision is None:
        return [Text(line) for line in _wrapped(f"stress test: driven as {driven_as(run)}", wide)]
    word = VERDICTS[decision.kind].upper()
    first, _, frequency = decision.sentence.rstrip(".").partition(_OFTEN)
    lines = _wrapped(f"{word}  {first.partition(': ')[2]}", wide)
    if frequency:
        short = re.sub(r"( of)? such moments| on(?=\))", "", frequency).replace("to test from", "test from")
        lines += _wrapped(f"  people collide {short}", wide)
    return [Text.assemble((word, _STYLES[decision.kind]), lines[0][len(word) :]), *map(Text, lines[1:])]


def metric_lines(run: Run, wide: int) -> list[Text]:
    """Return the main metrics of the stress test: how often they are critical, else their median."""
    parts = []
    for column in MAIN:
        if column not in run.columns or not len(run.samples(column)):
            continue
        metric, limit = run.metric(column), run.thresholds.get(column)
        name = metric.words.partition(" on ")[0].partition(" of ")[0]
        if limit is None:
            median = float(np.median(run.samples(column)))
            parts.append(f"{name} {median:.2g}{NARROW}{metric.column_unit or ''}")
        else:
            share = percent(run.p_critical(column).value)
            parts.append(f"{name}{NARROW}{metric.sign}{NARROW}{limit:.2g} in {share}")
    return [Text(line, style="dim") for line in _wrapped(", ".join(parts), wide)]


def _own_lines(run: Run, wide: int) -> list[Text]:
    lines = [
        f"{name}: {', human-like '.join(map(row_cell, values))}" for name, values in extra_rows(run).items()
    ]
    if counts := run.info.get("fallbacks"):
        from scex_sumo.results.tables.fallbacks import fallback_lines

        lines += fallback_lines(counts)
    return [Text(piece) for line in lines for piece in _wrapped(line, wide)]


def _doubts(run: Run, wide: int) -> list[Text]:
    doubtful = told_pairs(run, doubtful=True)
    if not doubtful:
        return []
    first = doubtful[0]
    more = f"; {len(doubtful) - 1} more" if len(doubtful) > 1 else ""
    text = f"left out as doubtful: {arrow(first)}, {first['doubt']}{more}"
    return [Text(textwrap.shorten(text, wide, placeholder=" …"), style="bright_black")]


def _decided_pair(run: Run) -> dict[str, Any]:
    """Return the row of the pair of the verdict, or its track ids where P is not told."""
    decision = run.decision
    assert decision is not None and decision.pair is not None
    pairs = [*told_pairs(run), *told_pairs(run, doubtful=True)]
    ids = dict(zip(("track_id", "other_id"), decision.pair, strict=True))
    return next((pair for pair in pairs if pair.items() >= ids.items()), ids)


def _table(run: Run, lines: Sequence[PairLine], total: Sequence[str], wide: int) -> list[Text]:
    if not lines:
        return []
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_edge=False)
    shown = [k for k in range(len(total)) if run.reference is not None or _HEADS[k] != "people"]
    for k in shown:
        folds: dict[str, Any] = {"overflow": "fold"} if k == 1 else {"no_wrap": True}
        table.add_column(Text(_HEADS[k], style="dim"), justify="left" if k < 2 else "right", **folds)
    decided = set(run.decision.pair or ()) if run.decision is not None else set()
    for line in lines:
        style = "bold" if set(line.pair) == decided else None
        table.add_row(*(line.cells[k] for k in shown), style=style)
    table.add_row(*(total[k] for k in shown))
    console = Console(width=wide, force_terminal=False, legacy_windows=False)
    rendered = console.render_lines(table, console.options.update(max_width=wide), pad=False)
    texts = [Text.assemble(*((part.text, part.style or "") for part in parts)) for parts in rendered]
    for text in texts:
        text.rstrip()
    return texts


def _collides(run: Run) -> str:
    collision = run.collision
    half = (collision.high - collision.low) / 2
    if half < 0.005:
        return percent(collision.value)
    if collision.value < half or collision.value > 1 - half:
        return f"{100 * collision.low:.0f} to {100 * collision.high:.0f}{NARROW}%"
    return f"{100 * collision.value:.0f} ± {100 * half:.0f}{NARROW}%"


def _wrapped(text: str, wide: int) -> list[str]:
    return textwrap.wrap(text, wide, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)
