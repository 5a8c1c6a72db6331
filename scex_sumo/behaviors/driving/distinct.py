"""Equal situations: what a vehicle knows of itself, and one answer handed out to all that are in the same."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.scene import Plan, SceneHistory, Who


def own_motion(history: SceneHistory, who: Who) -> FloatArray:
    """(n, 45) what n vehicles know of themselves: which one each is, and where it was."""
    own = history.states[who.child, who.vehicle]
    return np.concatenate([who.vehicle[:, None], own.x, own.y, own.heading, own.speed], axis=1)


def handed_out(made: Plan, kind: IntArray) -> Plan:
    """Plans of k kinds as those of n vehicles, of which `kind` (n,) says the kind."""
    return Plan(
        x=made.x[kind],
        y=made.y[kind],
        heading=made.heading[kind],
        speed=made.speed[kind],
        fallback=None if made.fallback is None else made.fallback[kind],
        reasons=tuple(made.reasons[k] for k in kind.tolist()) if made.reasons else (),
    )
