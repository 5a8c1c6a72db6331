"""Results of seeds as workers give them, made by hand."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.ranking.seeds import SeedRef
from scex_sumo.ranking.task import SeedPart


def seed_ref(seed: str, location: str = "here", time_s: float = 1.0) -> SeedRef:
    return SeedRef(seed=seed, location=location, recording="recording", case="", time_s=time_s, vehicles=3)


def seed_part(first: int, stop: int, *, tracks: pa.Table | None = None) -> SeedPart:
    """Children with values 100 child + column; the last column is undefined in the first child."""
    children = np.arange(first, stop)
    values = 100.0 * children[:, None] + np.arange(len(COLUMNS))
    defined = np.ones(values.shape, dtype=bool)
    defined[0, -1] = False
    values[0, -1] = np.nan
    return SeedPart(
        children=children,
        values=values,
        defined=defined,
        critical=np.zeros((len(children), 4), dtype=bool),
        fallbacks=np.arange(len(children)),
        kept=np.zeros(len(children), dtype=bool),
        models=(("a", "b", "a"),) * len(children),
        track_ids=np.array([7, 8, 9]),
        tracks=tracks,
    )
