"""Futures of a run as sumo-gui files: one future, an encounter, or several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.colors import Rgb, model_colors
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import writing
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import precedence_words, share_of
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.views.replay import write_view
from scex_sumo.world.drawings import FutureView


def write_future(run: Run, number: int) -> Path:
    """Write the view of one future, and return the file to open."""
    return _write(run, [_future_view(run, number)])


def write_first(run: Run) -> Path:
    """Write the future of the verdict's pair, else of the worst pair, else any; return the file to open."""
    decision, human = run.decision, run.reference
    if decision and human and decision.pair and decision.future is not None:
        step = round((decision.time_s or 0.0) / STEP_S)
        words = (decision.how or decision.what or "").replace("; ", " · ")  # SUMO takes no semicolon
        return _write(human, [_event_view(human, decision.future, decision.pair, step, words)])
    met = [encounter for encounter in run.encounters.to_pylist() if encounter["critical"] > 0]
    if met:
        return write_encounter(run, met[0]["track_id"], met[0]["other_id"])
    return write_future(run, 0)


def write_encounter(run: Run, first: int, second: int) -> Path:
    """Write a typical future in which two vehicles meet, and return the file to open."""
    encounter = run.encounter(first, second).row
    what, name = ("collides", COLLISION) if encounter["collision"] > 0 else ("critical", "critical")
    step, title = round(encounter["time_s"] / STEP_S), f"{what} in {share_of(encounter, name).share}"
    return _write(run, [_event_view(run, encounter["future"], [first, second], step, title)])


def write_grid(run: Run, count: int) -> Path:
    """Write the most different futures side by side, and return the file to open."""
    if not 2 <= count <= run.futures:
        raise UsageError(f"--grid {count}: give 2 to {run.futures}, the number of futures")
    return _write(run, [_future_view(run, number) for number in most_different(run, count).tolist()])


def most_different(run: Run, count: int) -> IntArray:
    """Return (count,) futures whose vehicles end in the most different places.

    Each is the farthest from those before it; the first is the farthest from the mean.
    """
    ends = [np.stack([block.x[:, :, -1], block.y[:, :, -1]], axis=-1) for block in run.state_blocks()]
    places = np.nan_to_num(np.concatenate(ends)).reshape(run.futures, -1)
    away = np.linalg.norm(places - places.mean(axis=0), axis=1)
    chosen: list[int] = []
    for number in range(count):
        chosen.append(int(np.argmax(away)))
        distance = np.linalg.norm(places - places[chosen[-1]], axis=1)
        away = distance if number == 0 else np.minimum(away, distance)
        away[chosen] = -1.0
    return np.array(chosen, dtype=np.int64)


def _future_view(run: Run, number: int, *, title: str = "", **event: Any) -> FutureView:
    states, models = run.states(number), run.models_of(number)
    return FutureView(number=number, states=states, models=models, title=title, past=LOGGED_HISTORY, **event)


def _event_view(run: Run, number: int, tracks: Sequence[int], step: int, what: str) -> FutureView:
    ids = list(run.info["seed_scene"]["track_ids"])
    stop = LOGGED_HISTORY - 1 + step  # the clock begins with the last second before the moment
    when = f"after {step * STEP_S:.1f} s (clock {(stop + 1) * STEP_S:.1f} s)"
    names = " and ".join(str(run.name_of(track)) for track in tracks)
    title = f"{what} · {names} {when}{precedence_words(run.info, tracks)}"
    event = [ids.index(track) for track in tracks if track in ids]  # people who are replayed have none
    return _future_view(run, number, title=title, event=event, stop=stop)


def colors_of(run: Run) -> dict[str, Rgb]:
    """Return the colour of each model, 0 to 255."""
    names = sorted(set(run.assignments["model"].unique().to_pylist()))
    return dict(zip(names, model_colors(names), strict=True))


def _write(run: Run, views: Sequence[FutureView]) -> Path:
    with writing(run.folder):
        return write_view(run.net.path.parent, run.net, run.scene, views, colors_of(run))
