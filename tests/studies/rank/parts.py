"""Results of moments as workers give them, made by hand."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.futures import MomentPart, futures_table
from scex_sumo.studies.rank.scores import RankSettings

SETTINGS = RankSettings(run=RunSettings(models="standard_driver,risky_driver", preset="paper"), first=32)
DRIVERS = ("standard_driver", "risky_driver", "standard_driver")


def moment_ref(moment: str, location: str = "here", time_s: float = 1.0) -> MomentRef:
    return MomentRef(
        moment=moment, location=location, recording="recording", case="", time_s=time_s, vehicles=3
    )


def pairs(future: int) -> np.ndarray:
    """Vehicles 7 and 9 come critically close in every future, and collide at 5 m/s in the even ones."""
    return np.array([[7, 9, 1 - future % 2, 500 * (1 - future % 2), 9000 * (1 - future % 2)]])


def moment_part(
    first: int, stop: int, *, tracks: pa.Table | None = None, models: tuple[str, ...] = DRIVERS
) -> MomentPart:
    """Futures with values 100 future + column; the last column is undefined in the first future."""
    futures = np.arange(first, stop)
    values = 100.0 * futures[:, None] + np.arange(len(COLUMNS))
    defined = np.ones(values.shape, dtype=bool)
    defined[0, -1] = False
    values[0, -1] = np.nan
    table = futures_table(
        futures,
        columns=COLUMNS,
        values=values,
        defined=defined,
        fallbacks=np.arange(len(futures)),
        kept=np.zeros(len(futures), dtype=bool),
        track_ids=np.array([7, 8, 9]),
        models=(models,) * len(futures),
        pairs=[pairs(future) for future in futures],
    )
    return MomentPart(futures=table, tracks=tracks)
