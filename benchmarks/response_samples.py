"""Actions, critical responses and what really happened, of moments of recordings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from scex_sumo import (
    LoadedRecording,
    find_recordings,
    load_recording,
    recording_moments,
    seed_at,
)
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.certainty.response.actions import (
    CUTS_IN,
    GOES_ON,
    LEVELS,
    Cases,
    Pairs,
    cases_of,
    leads_and_follows,
    pairs_of,
)
from scex_sumo.certainty.response.answer import doubts_of
from scex_sumo.certainty.response.blocked import Blocked, Lines, blocked_stretches
from scex_sumo.certainty.response.critical import Motion, contact, critical_response, hard_contact
from scex_sumo.certainty.response.expected import expected_motion
from scex_sumo.certainty.response.people import left_at, time_gaps
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.scene import STEP_S, SeedScene

AHEAD = 30  # steps after a moment in which events count
LINE_M = 1.5  # a vehicle further from its expected line drives another one
BEGINS = 20  # steps in which an initiator keeps up with its action
CAME_M = 1.5  # way to the side of one that has cut in


def near_gap(motion: Motion, upto: int = AHEAD) -> BoolArray:
    """Whether the gap is below 0.5 m while one drives."""
    moving = motion.speed[:, :upto] > 1.0
    return ((motion.gap[:, :upto] < 0.5) & moving).any(axis=1)


def short_ttc(motion: Motion, upto: int = AHEAD) -> BoolArray:
    """Whether the time to collision is below 1.5 s."""
    gap, closing = motion.gap[:, :upto], motion.closing[:, :upto]
    return ((gap < 1.5 * closing) & (closing > 1.0)).any(axis=1)


def strong_drac(motion: Motion, upto: int = AHEAD) -> BoolArray:
    """Whether the deceleration to avoid a crash is above 3.4 m/s²."""
    gap, closing = np.maximum(motion.gap[:, :upto], 1e-3), motion.closing[:, :upto]
    return ((closing**2 > 6.8 * gap) & (closing > 1.0)).any(axis=1)


NEAR = {"gap < 0.5 m": near_gap, "TTC < 1.5 s": short_ttc, "DRAC > 3.4 m/s²": strong_drac}
HAPPENS = {"contact": contact, "hard": hard_contact, **NEAR}


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Cases of many moments, n pairs' actions with ten values each, and p pairs.

    Attributes:
        moment: (n,) number of the moment.
        action: (n,); ``speed`` of the initiator (n,), m/s; ``follows`` (n,) whether it follows a leader.
        gap_s: (n,) as of `time_gaps`.
        response: (n, 10, E, A) R* of each of `HAPPENS`, s; ``left`` (n, 10, E, A) as of `left_at`.
        did: (n,) value of the parameter with which the initiator did it; NaN if it did not.
        known: (n,) whether that is known.
        doubtful: (n,).
        pair: (n,) index into the pairs.
        pair_moment: (p,); ``recorded`` (p, 3) whether each of `NEAR` was recorded, ``usual`` (p, 3) whether
            it happens as expected; ``pair_known`` (p,).
        surrogate: (p, 3) 1/TTC, DRAC and 1/THW at the moment.
        seconds: (M,) time that each moment stands for; ``vehicles`` (M,).
    """

    moment: IntArray
    action: IntArray
    speed: FloatArray
    follows: BoolArray
    gap_s: FloatArray
    response: FloatArray
    left: FloatArray
    did: FloatArray
    known: BoolArray
    doubtful: BoolArray
    pair: IntArray
    pair_moment: IntArray
    recorded: BoolArray
    usual: BoolArray
    pair_known: BoolArray
    surrogate: FloatArray
    seconds: FloatArray
    vehicles: FloatArray

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        """Join samples, with numbers of moments and pairs that go on."""
        moments = np.cumsum([0, *(len(part.seconds) for part in parts)])
        pairs = np.cumsum([0, *(len(part.pair_moment) for part in parts)])
        shift = {"moment": moments, "pair_moment": moments, "pair": pairs}
        columns = {}
        for field in fields(cls):
            values = [getattr(part, field.name) for part in parts]
            if field.name in shift:
                values = [v + at for v, at in zip(values, shift[field.name], strict=False)]
            columns[field.name] = np.concatenate(values)
        return cls(**columns)

    def save(self, file: Path) -> None:
        """Write a NumPy archive."""
        np.savez_compressed(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def read(cls, file: Path) -> Samples:
        """Read what `save` wrote."""
        with np.load(file) as content:
            return cls(**dict(content))


def samples_of(loaded: LoadedRecording, every_s: float) -> Samples | None:
    """Return the samples of a recording, a moment every so many seconds."""
    times = [moment.time_s for moment in recording_moments(loaded, every_s=every_s)]
    parts = [part for t in times if (part := _of_moment(loaded, t, every_s)) is not None]
    return Samples.joined(parts) if parts else None


def _of_moment(loaded: LoadedRecording, time_s: float, every_s: float) -> Samples | None:
    try:
        scene = seed_at(loaded, time_s)
    except TrackError:
        return None
    if scene.vehicles < 2 or scene.future is None or scene.future.shape[1] < AHEAD:
        return None
    pairs = pairs_of(expected_motion(scene))
    cases = cases_of(pairs)
    if not len(cases):
        return None
    first = slice(None, None, LEVELS)
    moved, on_line = _recorded_way(scene, pairs.expected.lines)
    did, known = _done(cases, moved, on_line, scene)
    responses = [critical_response(cases, happens) for happens in HAPPENS.values()]
    shape = (len(cases) // LEVELS, LEVELS, len(HAPPENS), -1)
    response = np.stack(responses, axis=1)
    left = np.stack([left_at(cases, one) for one in responses], axis=1)
    i, j = pairs.initiator, pairs.responder
    driven = _driven(cases, moved, scene)
    usual = _usual(pairs)
    gap, closing = usual.gap[:, 0], usual.closing[:, 0]
    with np.errstate(divide="ignore"):
        surrogate = np.stack(
            [
                np.where(np.isfinite(gap), closing / np.maximum(gap, 0.1), 0.0),
                np.where(np.isfinite(gap), closing**2 / (2 * np.maximum(gap, 0.1)), 0.0),
                np.where(np.isfinite(gap), scene.now.speed[j] / np.maximum(gap, 0.1), 0.0),
            ],
            axis=1,
        )
    return Samples(
        moment=np.zeros(len(cases) // LEVELS, dtype=np.int64),
        action=cases.action[first],
        speed=scene.now.speed[i[cases.pair[first]]],
        follows=leads_and_follows(pairs)[1][i[cases.pair[first]]],
        gap_s=time_gaps(cases)[first],
        response=response.reshape(shape),
        left=left.reshape(shape),
        did=did,
        known=known,
        doubtful=np.array([words is not None for words in doubts_of(pairs, cases.pair[first])]),
        pair=cases.pair[first],
        pair_moment=np.zeros(len(pairs), dtype=np.int64),
        recorded=np.stack([happens(driven) for happens in NEAR.values()], axis=1),
        usual=np.stack([happens(usual) for happens in NEAR.values()], axis=1),
        pair_known=on_line[i] & on_line[j],
        surrogate=surrogate,
        seconds=np.array([every_s]),
        vehicles=np.array([float(scene.vehicles)]),
    )


def _recorded_way(scene: SeedScene, lines: Lines) -> tuple[FloatArray, BoolArray]:
    """Return (V, F + 1) recorded arc lengths on expected lines, and (V,) whether vehicles stay on them."""
    assert scene.future is not None and scene.future_valid is not None
    x = np.column_stack([scene.now.x, scene.future.x])
    y = np.column_stack([scene.now.y, scene.future.y])
    dx, dy = x[:, :, None] - lines.x[:, None], y[:, :, None] - lines.y[:, None]
    nearest = np.argmin(dx * dx + dy * dy, axis=2)
    rows = np.arange(len(x))[:, None]
    heading = lines.heading[rows, nearest]
    dx, dy = x - lines.x[rows, nearest], y - lines.y[rows, nearest]
    s = lines.start[:, None] + nearest * lines.spacing_m + np.cos(heading) * dx + np.sin(heading) * dy
    off = np.abs(np.cos(heading) * dy - np.sin(heading) * dx)
    there = scene.future_valid[:, :AHEAD].all(axis=1)
    return s, there & (off[:, : AHEAD + 1] < LINE_M).all(axis=1)


def _outlines(scene: SeedScene, who: IntArray) -> Rectangles:
    assert scene.future is not None
    columns = {
        name: np.column_stack([getattr(scene.now, name), getattr(scene.future, name)])[who]
        for name in ("x", "y", "heading")
    }
    return Rectangles(
        **columns, half_length=scene.length[who][:, None] / 2, half_width=scene.width[who][:, None] / 2
    )


def _motion(blocked: Blocked, s: FloatArray) -> Motion:
    return Motion(cases=_Only(blocked), s=s, speed=np.maximum(np.gradient(s, STEP_S, axis=1), 0.0))  # type: ignore[arg-type]


class _Only:
    """Blocked stretches in the place of cases."""

    def __init__(self, blocked: Blocked) -> None:
        self.blocked = blocked


def _driven(cases: Cases, moved: FloatArray, scene: SeedScene) -> Motion:
    """Return the recorded motion of all pairs."""
    pairs = cases.pairs
    j = pairs.responder
    outlines = _outlines(scene, pairs.initiator)
    blocked = blocked_stretches(pairs.expected.lines, j, scene.length[j], scene.width[j], outlines)
    return _motion(blocked, moved[j])


def _usual(pairs: Pairs) -> Motion:
    return _motion(pairs.blocked, pairs.expected.s[pairs.responder])


def _done(
    cases: Cases, moved: FloatArray, on_line: BoolArray, scene: SeedScene
) -> tuple[FloatArray, BoolArray]:
    """Return (n,) the value of the parameter with which each initiator did it, NaN if not; and if known."""
    pairs, first = cases.pairs, slice(None, None, LEVELS)
    pair, action = cases.pair[first], cases.action[first]
    i, j = pairs.initiator[pair], pairs.responder[pair]
    done = np.full(len(pair), np.nan)
    assert scene.future_valid is not None
    known = scene.future_valid[i, :AHEAD].all(axis=1)
    speed = scene.now.speed[i]
    begun = BEGINS * STEP_S
    gained = moved[i, BEGINS] - speed * begun
    # It is in the responder's way before that one is there.
    expected = pairs.expected
    outlines = _outlines(scene, i)
    blocked = blocked_stretches(expected.lines, j, scene.length[j], scene.width[j], outlines)
    first_there = ((blocked.enter < np.inf) & (moved[j] < blocked.enter)).any(axis=1)
    goes = (action == GOES_ON) & first_there & (gained > -0.5)
    done[goes] = np.maximum(2 * gained[goes] / begun**2, 0.0)
    lines, future = expected.lines, scene.future
    assert future is not None
    off = []
    for step in (0, AHEAD - 1):
        x, y = (scene.now.x[i], scene.now.y[i]) if step == 0 else (future.x[i, step], future.y[i, step])
        nearest = np.argmin((lines.x[j] - x[:, None]) ** 2 + (lines.y[j] - y[:, None]) ** 2, axis=1)
        heading = lines.heading[j, nearest]
        off.append(np.cos(heading) * (y - lines.y[j, nearest]) - np.sin(heading) * (x - lines.x[j, nearest]))
    came = np.abs(off[0]) - np.abs(off[1])
    side = (action >= CUTS_IN) & (came > CAME_M) & first_there
    done[side] = came[side] / (AHEAD * STEP_S) * 1.5  # mean over the change; the most is some 1.5 times that
    return done, known


def collected(
    data: Path, cache: Path, *, every_s: float, part: int, parts: int
) -> Iterator[tuple[str, Samples]]:
    """Yield name and samples of recordings, kept in a folder; every so many of them from a part on."""
    cache.mkdir(parents=True, exist_ok=True)
    for recording in find_recordings([data])[part::parts]:
        file = cache / f"{recording.name}.npz"
        if not file.is_file():
            found = samples_of(load_recording(recording), every_s)
            if found is None:
                continue
            found.save(file)
        yield recording.name, Samples.read(file)
