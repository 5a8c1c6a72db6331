"""Encounters over all futures: probability, time, place, models and events of each pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.metrics.collisions import KINDS
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.metrics.events import EVENTS, MEASURED
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.cut_sets import CUT_SETS, LIFTS, DrawnModels, cut_set_words
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.results.tables.pairs import arrow, ends
from scex_sumo.roads.doubts import doubts_of
from scex_sumo.roads.places import places_of
from scex_sumo.scene import SeedScene, named
from scex_sumo.statistics.density import Interval
from scex_sumo.statistics.intervals import DesignIntervals

ENCOUNTERS: Final = "encounters.parquet"
QUESTIONS: Final = (*EVENTS, "critical")
"""Probabilities of a pair, each with ``_low`` and ``_high``; ``critical`` is any of the others."""

BITS: Final = {name: 1 << number for number, name in enumerate(EVENTS)}
"""Bit of each event in `pair_events`; a collision has all."""

SCHEMA: Final = schema(
    "track_id other_id name other_name",
    (name + end for name in QUESTIONS for end in ("", "_low", "_high")),
    "met consequence kind relative_speed expected_mais3 gap_p05 gap_p50 gap_p95 future gap model other_model",
    "time_s x y place doubt cut_sets lifts",
    consequence=pa.float64(),
    cut_sets=CUT_SETS,
    lifts=LIFTS,
)
"""One row a pair; ``met`` is the share of futures in which the pair has an encounter, ``expected_mais3`` the
mean number of severely injured occupants (MAIS 3+, one in each vehicle) over all futures. ``consequence`` is
the share in which the two touch, but one of them had collided before; nothing else counts those contacts.
``cut_sets`` and ``lifts``, see `DrawnModels`, are of collisions, else of the most frequent event."""

OUTCOMES_SCHEMA: Final = schema(
    "future track_a track_b",
    (event.column for event in MEASURED),
    **{event.column: pa.float32() for event in MEASURED},
)
"""One row a pair and future in which the value of some event is defined, sorted by pair and future.

``track_a`` is the lower id; values of `MEASURED` events, NaN where undefined.
"""

_GAPS = (0.05, 0.5, 0.95)


def encounters_table(
    encounters: Encounters,
    *,
    track_ids: IntArray,
    models: NDArray[np.str_],
    intervals: DesignIntervals,
    collisions: pa.Table | None = None,
    scene: SeedScene | None = None,
) -> pa.Table:
    """Tabulate the pairs of vehicles with an encounter, the most critical first.

    Args:
        track_ids: (V,).
        models: (C, V).
        collisions: of the futures, for their severity.
        scene: with its road: names, places, and which pairs are doubtful; None leaves them null.

    Returns:
        Columns of ``SCHEMA``, sorted by P(collision), P(critical), 5th percentile of the least gap.
        ``track_id`` hits or follows ``other_id``. ``gap``, ``model``, ``other_model``, ``time_s``, ``x``
        and ``y`` belong to ``future``, the typical future: its least gap, then its time, is the median of
        those that collide (else have the most frequent event, else meet). Gaps above 10 m are null.
    """
    number = encounters.first * len(track_ids) + encounters.second
    order = np.argsort(number, kind="stable")
    encounters, number = encounters.take(order), number[order]
    _, begins, which = np.unique(number, return_index=True, return_inverse=True)
    shares = {}
    for name, answer in _answers(encounters).items():
        full = np.zeros((intervals.count, len(begins)), dtype=np.bool_)  # False where a pair does not meet
        full[encounters.future[answer], which[answer]] = True
        shares[name] = intervals.all_shares(full)
    injured = _injured(collisions, len(models))
    rows, drawn = [], DrawnModels(track_ids, models)
    for index, (begin, end) in enumerate(pairwise([*begins.tolist(), len(number)])):
        row = _row(encounters.take(slice(begin, end)), drawn)
        row["expected_mais3"] = injured.get(frozenset((row["track_id"], row["other_id"])), 0.0)
        for name in QUESTIONS:
            share = shares[name][index]
            row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
        rows.append(row)
    if scene is not None and scene.road is not None:
        vehicle = {track: v for v, track in enumerate(scene.track_ids.tolist())}
        by_end = ([vehicle[row[name]] for row in rows] for name in ("track_id", "other_id"))
        first, second = (np.array(vehicles, np.int64) for vehicles in by_end)
        places = places_of(scene.road, np.array([(row["x"], row["y"]) for row in rows]).reshape(-1, 2))
        doubts = doubts_of(scene, first, second, names=scene.names)
        for row, a, b, place, doubt in zip(rows, first, second, places, doubts, strict=True):
            row |= {"place": place, "doubt": doubt, "name": scene.names[a], "other_name": scene.names[b]}
    rows.sort(key=criticality)
    return pa.Table.from_pylist(rows, schema=SCHEMA)


def outcomes_table(encounters: Encounters, track_ids: IntArray) -> pa.Table:
    """Tabulate the values of `MEASURED` events by pair and future, as ``OUTCOMES_SCHEMA`` says."""
    values = {event.column: event.defined(getattr(encounters, event.value)) for event in MEASURED}
    defined = np.any([~np.isnan(measured) for measured in values.values()], axis=0)
    a, b = np.sort(np.asarray(track_ids)[np.stack([encounters.first, encounters.second])], axis=0)
    order = np.lexsort((encounters.future, b, a))
    rows = order[defined[order]]
    columns = {"future": encounters.future, "track_a": a, "track_b": b, **values}
    arrays = [pa.array(columns[kind.name][rows]).cast(kind.type, safe=False) for kind in OUTCOMES_SCHEMA]
    return pa.table(arrays, schema=OUTCOMES_SCHEMA)


def _injured(collisions: pa.Table | None, futures: int) -> dict[frozenset[int], float]:
    """Return the expected severe injuries of each pair of track ids that collides, per future."""
    injured: dict[frozenset[int], float] = {}
    for hit in [] if collisions is None else first_contacts(collisions).to_pylist():
        pair = frozenset((hit["track_id"], hit["other_id"]))
        risk = (hit["p_mais3"] or 0.0) + (hit["p_mais3_other"] or 0.0)
        injured[pair] = injured.get(pair, 0.0) + risk / futures
    return injured


def criticality(row: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return the key that sorts pairs, the most critical first."""
    gap = row["gap_p05"]
    return (-row["collision"], -row["critical"], np.inf if gap is None else gap)


def _answers(encounters: Encounters) -> dict[str, BoolArray]:
    """Return (N,) whether the event of each question happens; a collision is each."""
    happens = {name: encounters.happens(event) for name, event in EVENTS.items()}
    return {**happens, "critical": np.any(list(happens.values()), axis=0)}


def _row(own: Encounters, drawn: DrawnModels) -> dict[str, Any]:
    """Return the row of a pair from its encounters in all futures, without shares."""
    futures, answers = len(drawn.models), _answers(own)
    first, second = int(own.first[0]), int(own.second[0])
    worst = [answers[name] for name in ("collision", "critical") if answers[name].any()]
    if own.towards[worst[0] if worst else slice(None)].sum() < 0:
        first, second = second, first
    event, _ = event_of({name: answer.sum() for name, answer in answers.items()})
    named = own.take(answers[event]) if event else own
    happens = np.isin(np.arange(futures), named.future)
    typical = np.lexsort((named.time_s, named.gap))[(len(named) - 1) // 2]
    future, hits = int(named.future[typical]), own.relative_speed[own.collided]
    gaps = np.concatenate([own.gap, np.full(futures - len(own), np.inf)])
    quantiles = np.quantile(gaps, _GAPS, method="inverted_cdf")
    return {
        "track_id": int(drawn.track_ids[first]),
        "other_id": int(drawn.track_ids[second]),
        "met": len(own) / futures,
        "consequence": float(own.consequence.sum() / futures),
        "kind": KINDS[int(named.kind[typical])] if hits.size else None,
        "relative_speed": float(np.median(hits)) if hits.size else None,
        **{f"gap_p{round(100 * level):02}": _near(gap) for level, gap in zip(_GAPS, quantiles, strict=True)},
        "future": future,
        "gap": _near(named.gap[typical]),
        "model": str(drawn.models[future, first]),
        "other_model": str(drawn.models[future, second]),
        "time_s": float(named.time_s[typical]),
        "x": float(named.x[typical]),
        "y": float(named.y[typical]),
        "cut_sets": drawn.cut_sets((first, second), happens) if event else [],
        "lifts": drawn.lifts((first, second), happens) if event else [],
    }


def _near(gap: float) -> float | None:
    return float(gap) if np.isfinite(gap) else None


def precedence_words(info: Mapping[str, Any], pair: Sequence[int]) -> str:
    """Return what the rules of the road say of a pair of vehicles, e.g. ``; 12 must yield``.

    Args:
        info: of the run.
    """
    known = info.get("precedence", ())
    source = info.get("seed_scene", {}).get("source") or {}
    duties = [(vehicle, duty) for vehicle, other, duty in known if {vehicle, other} == set(pair)]
    return "".join(f"; {named(source, vehicle)} {duty}" for vehicle, duty in duties)


def in_words(row: Mapping[str, Any]) -> str:
    """Return a row in words, e.g. ``17 → 23 (rear-end, ring, 1.8 s): collides in 12 % [9–16], ...``.

    It says in which futures its event always happened, else how both drove in the typical future.
    """
    about = [row["kind"], row["place"], f"{row['time_s']:.1f} s"]
    head = f"{arrow(row)} ({', '.join(detail for detail in about if detail)}): "
    gap = "more than 10" if row["gap"] is None else f"{row['gap']:.1f}"
    name, event = event_of(row)
    if not name:
        share = row["consequence"]
        aftermath = f", touches in {share:.1%} after an earlier collision" if share else ""
        return f"{head}{event}, typically {gap} m apart{aftermath}"
    if sets := cut_set_words(row):
        more = f" ({len(sets) - 1} more with encounters --pair)" if len(sets) > 1 else ""
        return f"{head}{event} in {share_of(row, name).percent}, {sets[0]}{more}"
    own, other = ends(row)
    drivers = f"{own} {row['model']}, {other} {row['other_model']}"
    apart = "" if name == "collision" else f"{gap} m apart, "
    return f"{head}{event} in {share_of(row, name).percent}, typically {apart}{drivers}"


def event_of(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return the question that a row answers, and the event in words; the first is empty if none happens."""
    if row["collision"] > 0:
        return "collision", EVENTS["collision"].words
    if row["critical"] > 0:
        event = max(MEASURED, key=lambda event: float(row[event.name]))
        return event.name, event.words
    return "", "never critical"


def share_of(row: Mapping[str, Any], name: str, futures: int = 0) -> Interval:
    """Return the share of a question with its interval; ``futures`` are all that were drawn."""
    value = float(row[name])
    low, high = float(row[f"{name}_low"]), float(row[f"{name}_high"])
    return Interval(value=value, low=low, high=high, count=round(value * futures))


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Encounter of two vehicles over all futures of a run.

    Attributes:
        row: of ``encounters.parquet``.
        run: `Run` that it belongs to.

    Example:
        >>> pair = run.encounter(run.encounters["track_id"][0].as_py(), run.encounters["other_id"][0].as_py())
        >>> 0 <= pair.collision.value <= 1
        True
    """

    row: Mapping[str, Any]
    run: Any = field(repr=False)

    @property
    def pair(self) -> tuple[int, int]:
        """Track ids, ascending."""
        first, second = sorted((self.row["track_id"], self.row["other_id"]))
        return first, second

    @property
    def collision(self) -> Interval:
        """Share of the futures in which the two collide."""
        return self.probability("collision")

    def probability(self, event: str) -> Interval:
        """Return the share of the futures with an event, one of `QUESTIONS`.

        It is at least that of a collision, which counts as each event.
        """
        _check_event(event)
        return share_of(self.row, event, self.run.futures)

    def happens(self, event: str) -> BoolArray:
        """Return (C,) whether an event, or any (``critical``), happens in each drawn future."""
        _check_event(event)
        bits = sum(BITS.values()) if event == "critical" else BITS[event]
        return np.asarray(pair_events(self.run, [self.pair])[0] & bits > 0)


def _check_event(event: str) -> None:
    if event not in QUESTIONS:
        raise UsageError(f"unknown event {event!r}; known: {', '.join(QUESTIONS)}")


def pair_events(run: Any, pairs: Sequence[tuple[int, int]]) -> IntArray:
    """Return (P, C) what happens to pairs of track ids in the futures of a `Run`, in `BITS`.

    Raises:
        ResultError: a table has a vehicle that the run does not have.
    """
    events = np.zeros((len(pairs), run.futures), dtype=np.int64)
    if not pairs:
        return events
    ids = np.sort(run.info["seed_scene"]["track_ids"])

    def index_of(tracks: Any) -> IntArray:
        index: IntArray = np.searchsorted(ids, tracks)
        if not np.array_equal(ids.take(index, mode="clip"), tracks):
            raise ResultError(
                f"{run.folder}: a pair has a vehicle that run.json has not; it was edited: run again"
            )
        return index

    number = np.full((len(ids), len(ids)), -1)
    for index, pair in enumerate(pairs):
        first, second = index_of(pair)
        number[first, second] = number[second, first] = index
    hits, met = first_contacts(run.collisions), run.pair_outcomes
    all_bits = np.full(hits.num_rows, sum(BITS.values()))
    happens = [BITS[event.name] * event.happens(np.asarray(met[event.column])) for event in MEASURED]
    of_hits = hits, ("track_id", "other_id"), all_bits
    of_met = met, ("track_a", "track_b"), np.sum(happens, axis=0)
    for table, names, bits in (of_hits, of_met):
        place = number[tuple(index_of(np.asarray(table[name])) for name in names)]
        events[place[place >= 0], np.asarray(table["future"])[place >= 0]] |= bits[place >= 0]
    return events
