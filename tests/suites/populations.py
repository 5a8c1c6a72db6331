"""Populations made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.suites.population import Population

KINDS = ("lead vehicle stopped", "merge", "head-on")


def candidate(k: int, rng: np.random.Generator, **given: Any) -> dict[str, Any]:
    row = {
        "location": "here",
        "recording": "r",
        "case": "",
        "seed": f"r_t{k}",
        "time_s": float(k),
        "conflict": KINDS[k % len(KINDS)],
        "track_id": 2 * k,
        "other_id": 2 * k + 1,
        "person": None,
        "probability": float(10 ** rng.uniform(-6, -2)),
        "share": 1.0,
    }
    return row | given


def population(count: int, *, seed: int = 0, **given: Any) -> Population:
    rng = np.random.default_rng(seed)
    return Population(
        rows=[candidate(k, rng, **given) for k in range(count)],
        hours=2.0,
        encounters=count,
        rare=7,
        doubtful=3,
        roots=("recordings",),
        moments=count,
    )
