"""Small seed scenes for tests, made by hand."""

from __future__ import annotations

import numpy as np

from scex_sumo.scene import SeedScene, States


def straight_seed(vehicles: int = 2, speed: float = 10.0) -> SeedScene:
    """Vehicles side by side, 10 m apart, driving along +x for the last second."""
    times = np.arange(-10, 1) * 0.1
    y = np.repeat(10.0 * np.arange(vehicles)[:, None], 11, axis=1)
    return SeedScene(
        name="straight",
        location="nowhere",
        time_s=0.0,
        track_ids=np.arange(vehicles),
        types=("car",) * vehicles,
        length=np.full(vehicles, 4.5),
        width=np.full(vehicles, 1.8),
        history=States(
            x=np.repeat(speed * times[None], vehicles, axis=0),
            y=y,
            heading=np.zeros_like(y),
            speed=np.full_like(y, speed),
        ),
        recorded_steps=np.full(vehicles, 10),
    )
