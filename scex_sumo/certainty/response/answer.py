"""Critical responses of a seed scene: the table of all pairs, and its sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.certainty.response.critical import (
    CAREFUL_S,
    HARD_MPS,
    TYPICAL,
    Motion,
    by_action,
    critical_response,
    hard_contact,
    responded,
)
from scex_sumo.certainty.response.maps import MAPPED, maps_of
from scex_sumo.certainty.response.motion.actions import (
    ACTIONS,
    BRAKES,
    LEVELS,
    TIME_S,
    Cases,
    Pairs,
    cases_of,
    contexts,
    pairs_of,
)
from scex_sumo.certainty.response.motion.expected import expected_motion
from scex_sumo.certainty.response.people import People, later_than, people_of, probabilities
from scex_sumo.certainty.response.room import Meeting, needed_braking, needed_swerve, time_to_react
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.extrapolation.job import has_rules, ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.results.tables.outcomes import masses, pair_injuries
from scex_sumo.road import Road
from scex_sumo.roads.doubts import doubts_of as scene_doubts
from scex_sumo.roads.matching import match
from scex_sumo.roads.places import places_of
from scex_sumo.scene import SeedScene

SELDOM: Final = 1e-4
"""Actions at least this often, and the one that is told, count for what a careful driver prevents."""
MOTIONS: Final = "the expected motions"
"""Begin of a doubt that is about the expected drivers, not about the recording."""
TOLD: Final = 1e-7
"""Probability from which a row is told."""
_MIN_PROBABILITY = 1e-9  # probability of a row


@checked
def critical_responses(scene: SeedScene, *, file: str | Path | None = None) -> pa.Table:
    """Return what it takes until two vehicles of a seed scene collide, and how often people let it happen.

    One row for each ordered pair and action with a probability of at least 1e-9, the most probable first;
    docs/response.md describes the columns.

    Args:
        scene: with its road.
        file: distributions of one's own, a JSON file as ``response.json`` of the package.

    Raises:
        UsageError: the file cannot be read, or a name in it is unknown.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.critical_responses(scene).column_names[:3]
        ['track_id', 'other_id', 'person']
    """
    return responses_and_maps(with_rules(scene), None if file is None else Path(file))[0]


def with_rules(scene: SeedScene) -> SeedScene:
    """Return a scene with the rules of its road, as a run has it."""
    if scene.rules is not None or scene.road is None or not has_rules(scene):
        return scene
    with TemporaryFolder() as folder:
        net = converted(scene.road, Path(folder) / "map.net.xml", keep=True)
        return ruled(scene, net, RunSettings())[0]


@owner_cache
def responses_and_maps(scene: SeedScene, file: Path | None) -> tuple[pa.Table, dict[str, Any]]:
    """Return the table of `critical_responses`, and the maps of its first rows that are told."""
    return _of_cases(cases_of(pairs_of(expected_motion(scene))), people_of(file))


def decisive_rows(cases: Cases, people: People) -> Sequence[Mapping[str, Any]]:
    """Return the rows of `critical_responses` for some cases, without factor, room to react and doubts."""
    if not len(cases):
        return []
    columns = _columns(cases, people, whole=False)[0]
    names = [name for name in SCHEMA.names if name in columns]
    return [
        dict(zip(names, row, strict=True)) for row in zip(*(columns[name] for name in names), strict=True)
    ]


def _of_cases(cases: Cases, people: People) -> tuple[pa.Table, dict[str, Any]]:
    if not len(cases):
        return SCHEMA.empty_table(), {}
    columns, kept, response, often = _columns(cases, people)
    table = pa.table([pa.array(list(columns[field.name]), field.type) for field in SCHEMA], schema=SCHEMA)
    rows = enumerate(table.to_pylist())
    told = [(k, row) for k, row in rows if row["probability"] >= TOLD and row["person"] is None]
    told.sort(key=lambda one: one[1]["doubt"] is not None)
    return table, maps_of(people, kept, response, often, dict(told[:MAPPED])) if told else {}


SCHEMA: Final = pa.schema(
    [
        ("track_id", pa.int64()),  # of the initiator
        ("other_id", pa.int64()),  # of the responder
        ("person", pa.string()),  # the initiator if it is no vehicle; its track_id is negative
        ("action", pa.string()),
        ("value", pa.float64()),
        ("frequency", pa.float64()),
        ("response_s", pa.float64()),
        ("later", pa.float64()),
        ("probability", pa.float64()),
        ("factor", pa.float64()),
        ("probability_hard", pa.float64()),
        ("delta_v", pa.float64()),
        ("expected_mais3", pa.float64()),
        ("time_s", pa.float64()),
        ("kind", pa.string()),
        ("needed_braking", pa.float64()),
        ("needed_swerve", pa.float64()),
        ("time_to_react", pa.float64()),
        ("preventable", pa.bool_()),
        ("doubt", pa.string()),
        ("unanswered", pa.float64()),  # P of a contact without any response
        ("acts", pa.float64()),  # how often the initiator does it at all
    ]
)


def _columns(
    cases: Cases, people: People, *, whole: bool = True
) -> tuple[dict[str, Any], Cases, FloatArray, FloatArray]:
    """Return the columns of `SCHEMA`, with the cases (ten a row), R* of them, and how often they happen.

    Args:
        whole: False for the columns of `decisive_rows` only.
    """
    pairs, response = cases.pairs, critical_response(cases)
    kinds, often = cases.action[::LEVELS], _often(cases, people, response)
    later = later_than(people, cases, response)
    value = probabilities(often, later, kinds)
    order = np.argsort(-value, kind="stable")
    order = order[value[order] >= _MIN_PROBABILITY]
    rows = (order[:, None] * LEVELS + np.arange(LEVELS)).ravel()
    cases, response = cases.take(rows), response[rows]
    kinds, often, later, value = kinds[order], often[order], later[order], value[order]
    level, frequency = _worst_levels(often, later, kinds)
    row, each = np.arange(len(level)) * LEVELS + level, np.arange(len(level))
    worst, told = cases.take(row), response[row, TYPICAL]
    told = np.where(told < np.inf, told, response[row].min(axis=1))
    late = later_than(people, cases, critical_response(cases, hard_contact))
    counts = often >= np.minimum(frequency, SELDOM)[:, None] * (1 - 1e-9)  # sums of shares are rounded
    careful = by_action(response[:, -1]) >= CAREFUL_S
    scene = pairs.expected.scene
    hard = np.minimum(probabilities(often, late, kinds), value)
    impact = _impact(worst, told, people, hard)
    columns = {
        "track_id": scene.track_ids[pairs.initiator[worst.pair]],
        "other_id": scene.track_ids[pairs.responder[worst.pair]],
        "person": [_person(scene, track) for track in scene.track_ids[pairs.initiator[worst.pair]]],
        "action": [ACTIONS[kind].name for kind in kinds],
        "value": worst.value,
        "frequency": frequency,
        "response_s": told,
        "later": later[each, level],
        "probability": value,
        "probability_hard": hard,
        **impact,
        "unanswered": probabilities(often, by_action(response[:, TYPICAL] < np.inf) * 1.0, kinds),
        "acts": often[:, 0],
        "preventable": np.asarray((careful | ~counts).all(axis=1)),
        "doubt": [None] * len(value),
    }
    if whole:
        others = [later_than(people.slower(factor), cases, response) for factor in _either(people)]
        spread = [probabilities(often, one, kinds) for one in others]
        columns |= {"factor": _factor(people.factors[kinds, level], *spread), **_room(worst)}
        columns |= {"doubt": doubts_of(pairs, worst.pair)}
    return columns, cases, response, often


def _person(scene: SeedScene, track: int) -> str | None:
    """Return kind and name of a pedestrian or cyclist by its negative id; None for a vehicle."""
    if track >= 0 or scene.obstacles is None:
        return None
    return f"{road_user(scene.obstacles.types[-1 - track])} {scene.obstacles.ids[-1 - track]}"


def _often(cases: Cases, people: People, response_s: FloatArray) -> FloatArray:
    pairs = cases.pairs
    who = pairs.initiator[cases.pair[::LEVELS]]
    return people.often(
        action=cases.action[::LEVELS],
        speed=pairs.expected.scene.now.speed[who],
        follows=contexts(pairs)[cases.pair[::LEVELS]],
        response_s=by_action(response_s[:, TYPICAL]),
    )


def _room(cases: Cases) -> dict[str, list[float | None]]:
    met = _meeting(cases)
    room = {
        "needed_braking": needed_braking(met),
        "needed_swerve": needed_swerve(met),
        "time_to_react": time_to_react(met),
    }
    return {name: [None if math.isnan(v) else v for v in values] for name, values in room.items()}


def _worst_levels(often: FloatArray, later: FloatArray, action: IntArray) -> tuple[IntArray, FloatArray]:
    """Return (n,) index of the value that is told, and how often it is at least so.

    Of braking it is the value with the largest product of both; of another action the least value with at
    least half of the worst probability of a late response, and only such values count.
    """
    share = often - np.concatenate([often[:, 1:], np.zeros_like(often[:, :1])], axis=1)
    weight = np.where((action == BRAKES)[:, None], often, share)
    level = np.argmax(weight * later, axis=1)
    counts = later >= later[np.arange(len(level)), level][:, None] / 2
    first = np.argmax(counts & (share > 0), axis=1)
    braking = action == BRAKES
    told = np.where(braking, often[np.arange(len(level)), level], (share * counts).sum(axis=1))
    return np.where(braking, level, first), told


def _either(people: People) -> tuple[float, float]:
    return 1 / people.response_factor, people.response_factor


def _factor(often: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the factor either way of 95 % from those of the frequency and of the responses."""
    responses = np.log(np.maximum(high, 1e-300) / np.maximum(low, 1e-300)) / 2
    return np.exp(np.hypot(np.log(often), responses))


def _impact(cases: Cases, response_s: FloatArray, people: People, hard: FloatArray) -> Mapping[str, Any]:
    """Return the impact at the median of too late responses: columns of `SCHEMA`.

    It is plastic. ``delta_v`` is that of the vehicle whose speed it changes more; ``expected_mais3`` counts
    one person of each, and hard contacts only, which have the probability ``hard`` and at least `HARD_MPS`:
    the curves were fitted to crashes, not to touches.
    """
    scene = cases.pairs.expected.scene
    assert scene.road is not None
    i, j = (side[cases.pair] for side in (cases.pairs.initiator, cases.pairs.responder))
    motion = too_late(cases, response_s, people)
    _, speed = motion.impact()
    mass = masses(scene.types, scene.length)
    share = np.stack([mass[j], mass[i]]) / (mass[i] + mass[j])
    row, first = np.arange(len(cases)), np.argmax(motion.cases.blocked.touches(motion.s), axis=1)
    kinds = [scene.types[v] for v in i.tolist()], [scene.types[v] for v in j.tolist()]
    injured = pair_injuries(kinds, share, np.maximum(speed, HARD_MPS)).sum(axis=0)
    x, y, _ = cases.pairs.expected.lines.at(j, motion.s[row, first])
    middle = np.stack([x + cases.outlines.x[row, first], y + cases.outlines.y[row, first]], axis=1) / 2
    return {
        "delta_v": share.max(axis=0) * speed,
        "expected_mais3": hard * injured,
        "time_s": TIME_S[first],
        "kind": places_of(scene.road, middle),
    }


def too_late(cases: Cases, response_s: FloatArray, people: People) -> Motion:
    """Return the motion at the median of the responses that come later than (m,) R*."""
    median = np.maximum(response_s, people.response_s[cases.action])
    begin = np.where(np.isfinite(response_s), np.maximum(response_s + 0.2, median), 0.0)
    return responded(cases, begin, 6.0)


def _meeting(cases: Cases) -> Meeting:
    """Return the responders against the motion of their initiators, from the seed moment on."""
    expected = cases.pairs.expected
    j = cases.pairs.responder[cases.pair]
    return Meeting(
        lines=expected.lines.take(j),
        speed=expected.scene.now.speed[j],
        length=expected.scene.length[j],
        width=expected.scene.width[j],
        other=cases.outlines,
        room=_room_beside(expected.scene)[j],
    )


def _room_beside(scene: SeedScene) -> FloatArray:
    """Return (V, 2) free width to the left and right of each vehicle on its lane and those beside it, m."""
    assert scene.road is not None
    now, room = scene.now, np.zeros((scene.vehicles, 2))
    matches = match(scene.road, now.x, now.y, now.heading)
    for k in matches.best.tolist():
        v = matches.vehicle[k]
        room[v] = _sides(scene.road, int(matches.lane_id[k]), float(scene.width[v]))
    return room


def _sides(road: Road, lane_id: int, width: float) -> tuple[float, float]:
    lane = road.lanes[lane_id]
    beside = [road.lanes[k].width_m if k is not None and k in road.lanes else 0.0 for k in lane.beside]
    free = max(lane.width_m - width, 0.0) / 2
    return free + beside[0], free + beside[1]


def doubts_of(pairs: Pairs, rows: IntArray) -> list[str | None]:
    """Return why pairs at indices (m,) are doubtful, their data or `MOTIONS`; None where they are not."""
    scene, one, other = pairs.expected.scene, pairs.initiator[rows], pairs.responder[rows]
    meet = pairs.blocked.touched(pairs.expected.s[pairs.responder])[rows]
    meet &= one < pairs.expected.vehicles  # people wait at the kerb, or step out
    names = [_person(scene, track) or str(track) for track in scene.track_ids.tolist()]
    doubts = scene_doubts(scene, one, other, vehicles=pairs.expected.vehicles, names=names)
    both = zip(scene.track_ids[one].tolist(), scene.track_ids[other].tolist(), strict=True)
    words = (f"{MOTIONS} of {a} and {b} overlap" for a, b in map(sorted, both))
    return [
        doubt or (overlap if is_so else None)
        for doubt, overlap, is_so in zip(doubts, words, meet.tolist(), strict=True)
    ]


def once_in(probability: float) -> str:
    """Return a probability as one of so many, one digit; "never" for 0."""
    if not probability:
        return "never"
    return f"once in {rounded(1 / probability)}" if probability < 0.5 else f"in {probability:.0%}"


def rounded(number: float) -> str:
    """Return a number with one digit, thousands apart."""
    size = 10 ** math.floor(math.log10(max(number, 1.0)))
    return f"{round(number / size) * size:,}".replace(",", " ")


def any_collision(rows: Iterable[Mapping[str, Any]], *, doubtful: bool = False) -> float:
    """Return P of a collision in any of the rows, those with doubtful data only if asked for."""
    return any_of(row["probability"] for row in rows if doubtful or row["doubt"] is None)


def any_of(probabilities: Iterable[float]) -> float:
    """Return 1 - Π (1 - P): as if independent."""
    return 0.0 - math.expm1(sum(math.log1p(-min(p, 1 - 1e-12)) for p in probabilities))
