"""Writer of seed scenes as INTERACTION v1.2 files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ResultError
from scex_sumo.converters.datasets.moment import CASE_FRAME
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States


def write_tracks(path: str | Path, scene: SeedScene) -> Path:
    """Write a seed scene and its recorded future atomically as one INTERACTION v1.2 case.

    Frame 10 (1000 ms) is the moment; frames 0 to 9 are the history. The format itself starts at frame 1.
    """
    import pyarrow as pa
    from pyarrow import csv

    path = Path(path)
    states = scene.history
    known = np.arange(HISTORY_STEPS + 1) >= HISTORY_STEPS - scene.recorded_steps[:, None]
    if scene.future is not None:
        states = States.concatenate([states, scene.future], axis=1)
        valid = np.ones(scene.future.shape, bool) if scene.future_valid is None else scene.future_valid
        known = np.concatenate((known, valid), axis=1)
    labels = [str(label) for label in scene.track_ids]
    parts = [_columns(labels, scene.types, scene.length, scene.width, states, known)]
    if scene.obstacles is not None:
        o = scene.obstacles
        parts.append(_columns(list(o.ids), o.types, o.length, o.width, o.states, o.present))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    table = pa.table({"case_id": ["1.0"] * len(columns["x"]), **columns})
    partial = path.with_name(path.name + ".partial")
    try:
        csv.write_csv(table, partial, csv.WriteOptions(quoting_style="none", quoting_header="none"))
        partial.replace(path)
    except OSError as error:
        raise ResultError(
            f"{path}: cannot be written ({error.strerror or error}); choose another place"
        ) from None
    return path


def _columns(
    labels: list[str],
    types: tuple[str, ...],
    length: FloatArray,
    width: FloatArray,
    states: States,
    known: BoolArray,
) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    user, step = np.nonzero(known)
    frame: IntArray = step - HISTORY_STEPS + CASE_FRAME
    heading, speed = states.heading[user, step], states.speed[user, step]
    return {
        "track_id": np.array(labels, object)[user].astype(str),
        "frame_id": frame,
        "timestamp_ms": frame * round(1000 * STEP_S),
        "agent_type": np.array(types, object)[user].astype(str),
        "x": states.x[user, step],
        "y": states.y[user, step],
        "vx": speed * np.cos(heading),
        "vy": speed * np.sin(heading),
        "psi_rad": heading,
        "length": length[user],
        "width": width[user],
    }
