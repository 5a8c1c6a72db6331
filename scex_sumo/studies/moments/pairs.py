"""Pairs of a moment: the critical responses of two vehicles together, one row each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.certainty.response.answer import SCHEMA, any_of, critical_responses
from scex_sumo.certainty.response.decision import PairResponse, pair_responses
from scex_sumo.certainty.response.motion.expected import Expected, expected_motion
from scex_sumo.certainty.response.typology import conflict_of
from scex_sumo.certainty.response.words import takes
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States

ROW: Final = ("person", "action", "value", "frequency", "response_s", "later", "factor", "delta_v", "kind")
"""Columns of the critical response that is told."""
ROOM: Final = ("needed_braking", "time_to_react")
PARAMETERS: Final = (
    *("angle_deg", "apart_m", "speed_mps", "other_speed_mps", "acceleration_mps2", "other_acceleration_mps2"),
    *("arrival_s", "other_arrival_s"),
)
"""Columns of a `Conflict`; those with ``other_`` are of the responder."""
OWN: Final = ("own_probability", "own_severity")
"""Columns of contacts of people after an action of the initiator: P, and severe injuries."""
PAIRS: Final = pa.schema(
    [
        ("track_id", pa.int64()),  # of the initiator
        ("other_id", pa.int64()),  # of the responder
        ("probability", pa.float64()),
        ("probability_hard", pa.float64()),
        ("severity", pa.float64()),
        ("takes", pa.string()),
        *(SCHEMA.field(name) for name in (*ROW, *ROOM)),
        ("contact_s", pa.float64()),
        ("to_test", pa.bool_()),
        ("preventable", pa.bool_()),
        ("doubt", pa.string()),
        ("gap_m", pa.float64()),
        ("conflict", pa.string()),  # of `typology.CONFLICTS`
        *((name, pa.float64()) for name in PARAMETERS),
        *((name, pa.float64()) for name in OWN),
    ]
)


def pairs_of_moment(scene: SeedScene) -> pa.Table:
    """Return the pairs of a seed scene with a road that may collide, see `PAIRS`.

    ``severity`` is the expected number of severe injuries; ``to_test`` as `decide` has it; ``gap_m`` the
    least distance of the outlines, as far as the scene knows the recording.
    """
    responses, expected = critical_responses(scene).to_pylist(), expected_motion(scene)
    rows = [_row(pair) for pair in pair_responses(responses)]
    orders: dict[tuple[int, int], list[Mapping[str, Any]]] = {}
    for response in responses:
        orders.setdefault((response["track_id"], response["other_id"]), []).append(response)
    place = {int(track): v for v, track in enumerate(expected.scene.track_ids)}
    one, other = ([place[row[name]] for row in rows] for name in ("track_id", "other_id"))
    gaps = _least_gaps(expected.scene, one, other)
    rows = [
        {**row, **_conflict(expected, i, j), **_own(orders[row["track_id"], row["other_id"]]), "gap_m": gap}
        for row, i, j, gap in zip(rows, one, other, gaps, strict=True)
    ]
    return pa.Table.from_pylist(rows, schema=PAIRS)


def _conflict(expected: Expected, one: int, other: int) -> Mapping[str, Any]:
    conflict = conflict_of(expected, one, other)
    both = (conflict.speeds, conflict.accelerations, conflict.arrivals_s)
    values = conflict.angle_deg, conflict.apart_m, *(value for pair in both for value in pair)
    return {"conflict": conflict.kind, **dict(zip(PARAMETERS, values, strict=True))}


def _own(responses: Sequence[Mapping[str, Any]]) -> Mapping[str, float]:
    severity = sum(response["expected_mais3"] for response in responses)
    return dict(zip(OWN, (any_of(response["probability"] for response in responses), severity), strict=True))


def _row(pair: PairResponse) -> Mapping[str, Any]:
    initiator, responder = pair.row["track_id"], pair.row["other_id"]
    return {
        "track_id": initiator,
        "other_id": responder,
        "probability": pair.probability,
        "probability_hard": pair.probability_hard,
        "severity": pair.expected_mais3,
        "takes": takes([pair.row]),
        **{name: pair.row[name] for name in (*ROW, *ROOM)},
        "contact_s": pair.row["time_s"],
        "to_test": pair.is_to_be_tested,
        "preventable": pair.preventable,
        "doubt": pair.doubt,
    }


def _least_gaps(scene: SeedScene, one: list[int], other: list[int]) -> list[float]:
    """Return the least distance of the outlines of vehicles (n,) in the recorded steps, m."""
    states, known = recorded(scene)
    first, second = (
        Rectangles.of(states[v], scene.length[v, None], scene.width[v, None]) for v in (one, other)
    )
    apart = rectangle_distance(first, second)
    least: list[float] = (
        np.where(known[one] & known[other], apart, np.inf).min(axis=1, initial=np.inf).tolist()
    )
    return least


def recorded(scene: SeedScene) -> tuple[States, np.ndarray[Any, np.dtype[np.bool_]]]:
    """Return the states (V, T) of a recording from 1 s before a moment on, and which of them are recorded."""
    history = np.arange(HISTORY_STEPS, -1, -1) <= scene.recorded_steps[:, None]
    if scene.future is None:
        return scene.history, history
    future = np.ones(scene.future.shape, np.bool_) if scene.future_valid is None else scene.future_valid
    states = States.concatenate([scene.history, scene.future], axis=1)
    return states, np.concatenate([history, future], axis=1)
