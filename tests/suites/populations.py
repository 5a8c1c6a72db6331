"""Populations made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.studies.moments.pairs import PARAMETERS
from scex_sumo.suites.population import Population

KINDS = ("lead vehicle stopped", "merge", "head-on")


def candidate(k: int, rng: np.random.Generator, **given: Any) -> dict[str, Any]:
    chance = float(10 ** rng.uniform(-8, -4))
    row: dict[str, Any] = {
        "location": "here",
        "recording": "r",
        "case": "",
        "seed": f"r_t{k}",
        "time_s": float(k),
        "takes": None,
        "kind": "lane",
        "conflict": KINDS[k % len(KINDS)],
        "factor": 4.0,
        "track_id": 2 * k,
        "other_id": 2 * k + 1,
        "person": None,
        "needed_braking": None,
        "probability": chance,
        "severity": chance / 100,
    }
    return row | dict(zip(PARAMETERS, rng.uniform(0, 10, len(PARAMETERS)).tolist(), strict=True)) | given


def population(count: int, *, seed: int = 0, **given: Any) -> Population:
    rng = np.random.default_rng(seed)
    return Population(
        rows=[candidate(k, rng, **given) for k in range(count)],
        hours=2.0,
        encounters=count,
        doubtful=3,
        roots=("recordings",),
        seeds=count,
    )
