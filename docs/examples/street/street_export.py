"""Futures in the columns of `street_tracks`, in feet."""

import numpy as np
from street_tracks import COLUMNS, FOOT_M, KINDS, MPH_MPS, STEP_S

CLASSES = {kind: code for code, kind in KINDS.items()}


def write_street(request):
    """Write a file for each future; returns the files."""
    return request.write_each(".csv", lambda future: content(request, future).encode())


def content(request, future):
    states, scene = request.states(future), request.scene  # (vehicles, steps)
    lines = [",".join(COLUMNS)]
    for v, track in enumerate(scene.track_ids):
        size = f"{scene.length[v] / FOOT_M:.2f},{scene.width[v] / FOOT_M:.2f}"
        for step in range(states.x.shape[1]):
            heading = 90.0 - np.rad2deg(states.heading[v, step])
            numbers = (
                step * STEP_S,
                states.x[v, step] / FOOT_M,
                states.y[v, step] / FOOT_M,
                heading % 360.0,
                states.speed[v, step] / MPH_MPS,
            )
            values = ",".join(f"{number:.3f}" for number in numbers)
            lines.append(f"{track},{CLASSES.get(scene.types[v], 'PC')},{values},{size}")
    return "\n".join([*lines, ""])
