"""Results of moments as workers give them, made by hand."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.rank.children import MomentPart, children_table
from scex_sumo.studies.rank.scores import RankSettings

SETTINGS = RankSettings(run=RunSettings(models="standard_driver,risky_driver", preset="paper"))
DRIVERS = ("standard_driver", "risky_driver", "standard_driver")


def moment_ref(moment: str, location: str = "here", time_s: float = 1.0) -> MomentRef:
    return MomentRef(
        moment=moment, location=location, recording="recording", case="", time_s=time_s, vehicles=3
    )


def pairs(child: int) -> np.ndarray:
    """Vehicles 7 and 9 come critically close in every child, and collide at 5 m/s in the even ones."""
    return np.array([[7, 9, 1 - child % 2, 500 * (1 - child % 2), 9000 * (1 - child % 2)]])


def moment_part(
    first: int, stop: int, *, tracks: pa.Table | None = None, models: tuple[str, ...] = DRIVERS
) -> MomentPart:
    """Children with values 100 child + column; the last column is undefined in the first child."""
    children = np.arange(first, stop)
    values = 100.0 * children[:, None] + np.arange(len(COLUMNS))
    defined = np.ones(values.shape, dtype=bool)
    defined[0, -1] = False
    values[0, -1] = np.nan
    table = children_table(
        children,
        columns=COLUMNS,
        values=values,
        defined=defined,
        fallbacks=np.arange(len(children)),
        kept=np.zeros(len(children), dtype=bool),
        track_ids=np.array([7, 8, 9]),
        models=(models,) * len(children),
        pairs=[pairs(child) for child in children],
    )
    return MomentPart(children=table, tracks=tracks)
