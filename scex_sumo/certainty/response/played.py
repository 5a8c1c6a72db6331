"""Motion of a critical response: an initiator acts, a responder is too late, until both touch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scex_sumo.certainty.response.answer import too_late
from scex_sumo.certainty.response.motion.actions import ACTIONS, cases_of, pairs_of
from scex_sumo.certainty.response.motion.expected import expected_motion
from scex_sumo.certainty.response.people import people_of
from scex_sumo.scene import SeedScene, States


def played(scene: SeedScene, row: Mapping[str, Any]) -> States:
    """Return states (2, T) of initiator and responder from the seed moment until contact.

    Args:
        scene: with its road.
        row: of ``response.parquet``: which vehicles, the action with its value, and ``response_s``.
    """
    pairs = pairs_of(expected_motion(scene))
    ids, cases = pairs.expected.scene.track_ids, cases_of(pairs)
    kind = [action.name for action in ACTIONS].index(row["action"])
    one, other = ids[pairs.initiator[cases.pair]], ids[pairs.responder[cases.pair]]
    is_row = (one == row["track_id"]) & (other == row["other_id"]) & (cases.action == kind)
    at = np.argmin(np.where(is_row, np.abs(cases.value - row["value"]), np.inf))
    case = cases.take(np.array([at]))
    motion = too_late(case, np.array([row["response_s"]]), people_of())
    stop = 1 + int(np.argmax(case.blocked.touches(motion.s)[0]))
    x, y, heading = pairs.expected.lines.at(pairs.responder[case.pair], motion.s)
    speed = np.stack([np.hypot(*case.velocity[0].T), motion.speed[0]])
    first = case.outlines
    whole = States(
        x=np.concatenate([first.x, x]),
        y=np.concatenate([first.y, y]),
        heading=np.concatenate([first.heading, heading]),
        speed=speed,
    )
    return whole[:, :stop]
