"""Writer of seed scenes as INTERACTION v1.2 files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.files import replacing
from scex_sumo.converters.datasets.moment import CASE_FRAME
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

Columns = dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]]


def write_tracks(path: str | Path, *scenes: SeedScene) -> Path:
    """Write seed scenes and their recorded futures atomically as INTERACTION v1.2 cases ``1.0``, ``2.0`` ...

    Frame 10 (1000 ms) is the moment; frames 0 to 9 are the history. The format itself starts at frame 1.
    """
    import pyarrow as pa
    from pyarrow import csv

    path = Path(path)
    tables = [columns for k, scene in enumerate(scenes) for columns in _case(f"{k + 1}.0", scene)]
    table = pa.table({name: np.concatenate([columns[name] for columns in tables]) for name in tables[0]})
    with replacing(path) as temporary:
        csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="none", quoting_header="none"))
    return path


def _case(case: str, scene: SeedScene) -> list[Columns]:
    """Return the columns of a scene's vehicles, and of its obstacles."""
    states = scene.history
    known = np.arange(HISTORY_STEPS + 1) >= HISTORY_STEPS - scene.recorded_steps[:, None]
    if scene.future is not None:
        states = States.concatenate([states, scene.future], axis=1)
        valid = np.ones(scene.future.shape, bool) if scene.future_valid is None else scene.future_valid
        known = np.concatenate((known, valid), axis=1)
    labels = [str(label) for label in scene.track_ids]
    tables = [_columns(case, labels, scene.types, scene.length, scene.width, states, known)]
    if (o := scene.obstacles) is not None:
        tables.append(_columns(case, list(o.ids), o.types, o.length, o.width, o.states, o.present))
    return tables


def _columns(
    case: str,
    labels: list[str],
    types: tuple[str, ...],
    length: FloatArray,
    width: FloatArray,
    states: States,
    known: BoolArray,
) -> Columns:
    user, step = np.nonzero(known)
    frame: IntArray = step - HISTORY_STEPS + CASE_FRAME
    heading, speed = states.heading[user, step], states.speed[user, step]
    return {
        "case_id": np.full(len(user), case),
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
