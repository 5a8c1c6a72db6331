"""Actions, critical responses and what really happened, of moments of recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from pickle import dumps, loads
from tempfile import TemporaryDirectory

import numpy as np

from scex_sumo import LoadedRecording, find_recordings, load_recording, recording_moments, seed_at
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.certainty.response.answer import doubts_of
from scex_sumo.certainty.response.critical import (
    DECELERATIONS,
    TYPICAL,
    Happens,
    Motion,
    contact,
    critical_response,
    hard_contact,
)
from scex_sumo.certainty.response.motion.actions import (
    ACTIONS,
    BRAKES,
    CUTS_IN,
    DRIFTS,
    GOES_ON,
    LEVELS,
    STEPS_OUT,
    TIME_S,
    Cases,
    Pairs,
    cases_of,
    contexts,
    pairs_of,
)
from scex_sumo.certainty.response.motion.blocked import Blocked, Lines, blocked_stretches
from scex_sumo.certainty.response.motion.expected import Expected, expected_motion
from scex_sumo.certainty.response.people import left_at, time_gaps
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

AHEAD = 30  # steps after a moment that have to be recorded
WINDOW = slice(10, AHEAD)  # in which near misses count: 1 to 3 s later
PET_STEPS = 10
CROSSES_RAD = np.deg2rad(30.0)
CLOSES_MPS = 1.0
VARIES_MPS2 = np.linspace(-2.5, 2.5, 11)  # of the responder, beside its expected motion
LINE_M = 1.5  # a vehicle further from its expected line drives another one
BEGINS = 20  # steps in which an initiator keeps up with its action
DUT_HZ, CAR_M, PERSON_M = 23.98, (4.6, 1.8), (0.6, 0.6)  # the data have no sizes
MEAN_STEPS = 15  # over which the mean deceleration counts
CAME_M = 1.5  # way to the side of one that has cut in


def closing(motion: Motion) -> FloatArray:
    """Return (m, T) speed towards the initiator along the line, m/s; 0 without a gap.

    It is not the change of the gap: that jumps where a box turns or drifts into the line.
    """
    return np.where(np.isfinite(motion.gap), np.maximum(motion.speed - motion.cases.along, 0.0), 0.0)


@dataclass(frozen=True)
class Near:
    """Near miss: whether it happens from 1 to 3 s after a moment, by its steps (m, T)."""

    steps: Callable[[Motion], BoolArray]

    def __call__(self, motion: Motion) -> BoolArray:
        """Return whether it happens (m,)."""
        return self.steps(motion)[:, WINDOW].any(axis=1)

    def left(self, motion: Motion) -> FloatArray:
        """Return the share (m,) of the largest gap that is left when it happens; 0 where it does not."""
        there = self.steps(motion)[:, WINDOW]
        first = np.argmax(there, axis=1) + WINDOW.start
        gap = np.where(np.isfinite(motion.gap), np.maximum(motion.gap, 0.1), 0.0)
        until = np.arange(gap.shape[1]) <= first[:, None]
        most = np.where(until, gap, 0.0).max(axis=1)
        now = gap[np.arange(len(gap)), first]
        return np.where(there.any(axis=1), np.where(now > 0, now / np.maximum(most, 0.1), 1.0), 0.0)


def _drives(motion: Motion) -> BoolArray:
    return motion.speed > CLOSES_MPS


def near_gap(motion: Motion) -> BoolArray:
    """Whether the gap is below 0.5 m while one drives."""
    return (motion.gap < 0.5) & _drives(motion)


def short_ttc(motion: Motion) -> BoolArray:
    """Whether the time to collision is below 1.5 s."""
    speed = closing(motion)
    return (motion.gap < 1.5 * speed) & (speed > CLOSES_MPS) & _drives(motion)


def strong_drac(motion: Motion) -> BoolArray:
    """Whether the deceleration to avoid a crash is above 3.4 m/s²."""
    gap, speed = np.maximum(motion.gap, 1e-3), closing(motion)
    return (speed**2 > 6.8 * gap) & (speed > CLOSES_MPS) & _drives(motion)


def short_pet(motion: Motion) -> BoolArray:
    """Whether one is where a crossing vehicle was in the last second."""
    return motion.cases.crossed.touches(motion.s)


def bump(motion: Motion) -> BoolArray:
    """Whether both vehicles touch at a relative speed of 2 m/s or more."""
    hit, speed = motion.impact()
    return hit & (speed >= 2.0)


NEAR = {
    "TTC < 1.5 s": Near(short_ttc),
    "DRAC > 3.4 m/s²": Near(strong_drac),
    "PET < 1 s": Near(short_pet),
    "gap < 0.5 m": Near(near_gap),
}
HAPPENS = {"contact": contact, "bump": bump, "hard": hard_contact, **NEAR}


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Cases of many moments, n pairs' actions with ten values each, and p pairs.

    Attributes:
        moment: (n,) number of the moment.
        action: (n,); ``speed`` of the initiator (n,), m/s; ``follows`` (n,) as of `contexts`.
        slows: (n,) least acceleration of the initiator's expected motion within 3 s, m/s².
        gap_s: (n,) as of `time_gaps`.
        response: (n, 10, E, A) R* of each of `HAPPENS`, s; ``left`` (n, 10, E, A) as of `left_at`.
        did: (n,) value of the parameter with which the initiator did it; NaN if it did not.
        known: (n,) whether that is known.
        doubtful: (n,).
        pair: (n,) index into the pairs.
        pair_moment: (p,); ``recorded`` (p, 4) whether each of `NEAR` was recorded, ``usual`` (p, 4, 11)
            `Near.left` as expected, with each of `VARIES_MPS2` besides; ``pair_known`` (p,).
        surrogate: (p, 3) 1/TTC, DRAC and 1/THW at the moment.
        seconds: (M,) time that each moment stands for; ``vehicles`` (M,); ``km`` (M,) that they drive in it.
    """

    moment: IntArray
    action: IntArray
    speed: FloatArray
    slows: FloatArray
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
    usual: FloatArray
    pair_known: BoolArray
    surrogate: FloatArray
    seconds: FloatArray
    vehicles: FloatArray
    km: FloatArray

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


def expected_of(loaded: LoadedRecording, every_s: float) -> list[Expected]:
    """Return the expected motion of moments with 3 s recorded after them."""
    found = []
    with TemporaryDirectory() as folder:
        net = converted(loaded.road, Path(folder) / "map.net.xml")
        for moment in recording_moments(loaded, every_s=every_s):
            try:
                scene, _ = ruled(seed_at(loaded, moment.time_s), net, RunSettings())
            except TrackError:
                continue
            if scene.future is not None and scene.future.shape[1] >= AHEAD:
                found.append(expected_motion(scene))
    return found


def samples_of(expected: Expected, every_s: float) -> Samples | None:
    """Return the samples of a moment that stands for so many seconds."""
    pairs = pairs_of(expected)
    plain = cases_of(pairs)
    if not len(plain):
        return None
    scene, moving = expected.scene, pairs.initiator < expected.vehicles
    cases = Watched.of(plain)
    first = slice(None, None, LEVELS)
    moved, on_line = _recorded_way(scene, expected.lines)
    did, known = _done(cases, moved, scene)
    responses = [_responses(cases, happens) for happens in HAPPENS.values()]
    shape = (len(cases) // LEVELS, LEVELS, len(HAPPENS), -1)
    i, j = pairs.initiator, pairs.responder
    assert scene.future is not None
    speeds = np.column_stack([scene.now.speed, scene.future.speed])
    driven = _motion(pairs, moved[j], (_outlines(scene, i), speeds[i]))
    overlap = driven.cases.blocked.touches(driven.s)[:, : AHEAD + 1].any(axis=1)
    usual = _motion(pairs, expected.s[j])
    gap, speed = np.maximum(usual.gap[:, 0], 0.1), closing(usual)[:, 0]
    surrogate = np.stack([speed / gap, speed**2 / (2 * gap), scene.now.speed[j] / gap], axis=1)
    doubts = np.array(doubts_of(pairs, np.arange(len(pairs))), dtype=object)
    slows = np.diff(expected.speed[:, : AHEAD + 1], axis=1).min(axis=1) / STEP_S
    return Samples(
        moment=np.zeros(len(cases) // LEVELS, dtype=np.int64),
        action=cases.action[first],
        speed=scene.now.speed[i[cases.pair[first]]],
        slows=slows[i[cases.pair[first]]],
        follows=contexts(pairs)[cases.pair[first]],
        gap_s=time_gaps(cases)[first],
        response=np.stack(responses, axis=1).reshape(shape).astype(np.float32),
        left=np.stack([left_at(cases, r) for r in responses], axis=1).reshape(shape).astype(np.float32),
        did=did,
        known=known,
        doubtful=(doubts != None)[cases.pair[first]],  # noqa: E711
        pair=cases.pair[first],
        pair_moment=np.zeros(len(pairs), dtype=np.int64),
        recorded=np.stack([happens(driven) for happens in NEAR.values()], axis=1),
        usual=np.stack([_if_varied(usual, near) for near in NEAR.values()], axis=1),
        pair_known=on_line[i] & on_line[j] & moving & (doubts == None) & ~overlap,  # noqa: E711
        surrogate=surrogate,
        seconds=np.array([every_s]),
        vehicles=np.array([float(expected.vehicles)]),
        km=np.array([scene.now.speed[: expected.vehicles].sum() * every_s / 1000]),
    )


def _if_varied(motion: Motion, near: Near) -> FloatArray:
    """Return `Near.left` (p, 11) with each of `VARIES_MPS2` besides the expected motion."""
    found = []
    for a in VARIES_MPS2:
        speed = np.maximum(motion.speed + a * TIME_S, 0.0)
        s = motion.s[:, :1] + np.cumsum(speed, axis=1) * STEP_S - speed[:, :1] * STEP_S
        found.append(near.left(motion if a == 0 else replace(motion, s=s, speed=speed)))
    return np.stack(found, axis=1).astype(np.float32)


def _responses(cases: Cases, happens: Happens) -> FloatArray:
    """Return R* (m, A); that of near misses is the one at the typical deceleration."""
    if happens in (contact, hard_contact):
        return critical_response(cases, happens)
    found = critical_response(cases, happens, (DECELERATIONS[TYPICAL],))
    return np.repeat(found, len(DECELERATIONS), axis=1)


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched(Cases):
    """Cases with what near misses need.

    Attributes:
        crossed: stretches that crossing initiators blocked in the last second.
        along: (m, T) speed of initiators along the responders' lines, m/s.
    """

    crossed: Blocked
    along: FloatArray

    @classmethod
    def of(cls, cases: Cases) -> Watched:
        """Add the stretches to cases."""
        j = cases.pairs.responder[cases.pair]
        columns = {field.name: getattr(cases, field.name) for field in fields(Cases)}
        heading = _line_heading(cases.blocked, cases.pairs.expected.lines, j)
        along = cases.velocity[..., 0] * np.cos(heading) + cases.velocity[..., 1] * np.sin(heading)
        return cls(**columns, crossed=_crossed(cases.blocked, heading - cases.outlines.heading), along=along)

    def take(self, index: IntArray) -> Watched:
        """Select rows by index."""
        part = super().take(index)
        columns = {field.name: getattr(part, field.name) for field in fields(Cases)}
        return Watched(**columns, crossed=self.crossed.take(index), along=self.along[index])


def _line_heading(blocked: Blocked, lines: Lines, row: IntArray) -> FloatArray:
    """Return (m, T) headings of lines where they begin to be blocked."""
    return lines.at(row, np.where(np.isfinite(blocked.enter), blocked.enter, 0.0))[2]


def _crossed(blocked: Blocked, turn: FloatArray) -> Blocked:
    there = np.isfinite(blocked.enter)
    crosses = there & (np.abs(np.sin(turn)) > np.sin(CROSSES_RAD))
    enter, leave = np.where(crosses, blocked.enter, np.inf), np.where(crosses, blocked.leave, -np.inf)
    for step in range(1, PET_STEPS + 1):
        at, before = (slice(None), slice(step, None)), (slice(None), slice(None, -step))
        if step == 1:
            least, most = enter.copy(), leave.copy()
        least[at] = np.minimum(least[at], enter[before])
        most[at] = np.maximum(most[at], leave[before])
    return Blocked(enter=least, leave=most)


@dataclass(frozen=True)
class _Only:
    """Blocked stretches in the place of cases."""

    blocked: Blocked
    crossed: Blocked
    along: FloatArray


def _motion(pairs: Pairs, s: FloatArray, driven: tuple[Rectangles, FloatArray] | None = None) -> Motion:
    """Return the motion of all pairs' responders, against driven outlines and speeds if given."""
    i, j, expected = pairs.initiator, pairs.responder, pairs.expected
    blocked, lines, scene = pairs.blocked, expected.lines, expected.scene
    turned, speed_i = lines.at(i, expected.s[i])[2], expected.speed[i]
    if driven is not None:
        turned, speed_i = driven[0].heading, driven[1]
        blocked = blocked_stretches(lines, j, scene.length[j], scene.width[j], driven[0])
    turn = _line_heading(blocked, lines, j) - turned
    only = _Only(blocked, _crossed(blocked, turn), speed_i * np.cos(turn))
    speed = np.maximum(np.gradient(s, STEP_S, axis=1), 0.0)
    return Motion(cases=only, s=s, speed=speed)  # type: ignore[arg-type]


def _done(cases: Cases, moved: FloatArray, scene: SeedScene) -> tuple[FloatArray, BoolArray]:
    """Return (n,) the value of the parameter with which each initiator did it, NaN if not; and if known."""
    pairs, first = cases.pairs, slice(None, None, LEVELS)
    pair, action = cases.pair[first], cases.action[first]
    i, j = pairs.initiator[pair], pairs.responder[pair]
    done = np.full(len(pair), np.nan)
    assert scene.future is not None and scene.future_valid is not None
    known = scene.future_valid[i, :AHEAD].all(axis=1)
    begun = BEGINS * STEP_S
    gained = moved[i, BEGINS] - scene.now.speed[i] * begun
    # It is in the responder's way before that one is there.
    expected = pairs.expected
    outlines = _outlines(scene, i)
    blocked = blocked_stretches(expected.lines, j, scene.length[j], scene.width[j], outlines)
    there = (blocked.enter < np.inf) & (moved[j] < blocked.enter)
    first_there = there.any(axis=1)
    speeds = np.column_stack([scene.now.speed, scene.future.speed[:, :AHEAD]])[i]
    lost = (speeds[:, :-MEAN_STEPS] - speeds[:, MEAN_STEPS:]).max(axis=1) / (MEAN_STEPS * STEP_S)
    done[action == BRAKES] = np.maximum(lost, 0.0)[action == BRAKES]
    goes = (action == GOES_ON) & first_there & (gained > -0.5)
    done[goes] = np.maximum(2 * gained[goes] / begun**2, 0.0)
    off = np.stack([_beside(expected.lines, scene, i, j, step) for step in range(AHEAD)], axis=1)
    came = np.abs(off[:, 0]) - np.abs(off[:, -1])
    side = ((action == CUTS_IN) | (action == DRIFTS)) & (came > CAME_M) & first_there
    done[side] = came[side] / (AHEAD * STEP_S) * 1.5  # mean over the change; the most is some 1.5 times that
    # Who steps out before the other one has begun to yield.
    at = np.argmax(there, axis=1).clip(1, AHEAD - 1)
    each = np.arange(len(at))
    drives = moved[j, at] > expected.s[j, at] - CAME_M
    steps = (action == STEPS_OUT) & there[:, :AHEAD].any(axis=1) & drives
    fast = (np.abs(off[:, 0]) - np.abs(off[each, at])) / (at * STEP_S)
    done[steps] = np.maximum(fast[steps], ACTIONS[STEPS_OUT].values[0])
    return done, known


def _beside(lines: Lines, scene: SeedScene, i: IntArray, j: IntArray, step: int) -> FloatArray:
    """Return (n,) recorded offsets of initiators from the responders' lines after some steps, m."""
    assert scene.future is not None
    at = scene.now if step == 0 else scene.future[:, step - 1]
    x, y = at.x[i], at.y[i]
    nearest = np.argmin((lines.x[j] - x[:, None]) ** 2 + (lines.y[j] - y[:, None]) ** 2, axis=1)
    heading = lines.heading[j, nearest]
    return np.asarray(
        np.cos(heading) * (y - lines.y[j, nearest]) - np.sin(heading) * (x - lines.x[j, nearest])
    )


def dut_moments(file: Path, every_s: float) -> list[Expected]:
    """Return moments of a clip of VCI-DUT, by its file of vehicles; they are expected to drive straight."""
    users = []
    for kind, name in (("veh", file), ("ped", file.with_name(file.name.replace("_veh", "_ped")))):
        rows = np.genfromtxt(name, delimiter=",", names=True, usecols=range(7) if kind == "veh" else None)
        rows = rows[np.argsort(rows["frame"], kind="stable")]
        for number in np.unique(rows["id"]):
            one = rows[rows["id"] == number]
            motion = (one["psi_est"], one["vel_est"]) if kind == "veh" else (one["vx_est"], one["vy_est"])
            if kind == "ped":
                motion = np.arctan2(motion[1], motion[0]), np.hypot(*motion)
            columns = np.stack([one["x_est"], one["y_est"], np.unwrap(motion[0]), motion[1]])
            users.append((kind == "veh", one["frame"] / DUT_HZ, columns))
    end = max(time[-1] for _, time, _ in users)
    found = [_dut_moment(users, t) for t in np.arange(1.0, end - AHEAD * STEP_S, every_s)]
    return [one for one in found if one is not None]


def dut_samples(data: Path, cache: Path, every_s: float) -> None:
    """Write the samples of each clip of VCI-DUT."""
    cache.mkdir(parents=True, exist_ok=True)
    for file in sorted(data.glob("*_veh.csv.gz")):
        found = [part for one in dut_moments(file, every_s) if (part := samples_of(one, every_s))]
        if found:
            Samples.joined(found).save(cache / f"{file.name.partition('_veh')[0]}.npz")


def _dut_moment(users: list[tuple[bool, FloatArray, FloatArray]], now_s: float) -> Expected | None:
    times = now_s + STEP_S * np.arange(-HISTORY_STEPS, AHEAD + 1)
    here = [user for user in users if user[1][0] <= times[0] and user[1][-1] >= now_s + STEP_S]
    here.sort(key=lambda user: not user[0])
    vehicles = sum(user[0] for user in here)
    if vehicles in (0, len(here)):
        return None
    values = np.stack([[np.interp(times, time, column) for column in rows] for _, time, rows in here])
    x, y, heading, speed = values.swapaxes(0, 1)
    whole = States(x=x, y=y, heading=heading, speed=speed)
    size = np.array([CAR_M if user[0] else PERSON_M for user in here])
    scene = SeedScene(
        name="dut",
        location="dut",
        time_s=now_s,
        track_ids=np.where(np.arange(len(here)) < vehicles, np.arange(len(here)), -1),
        types=tuple("car" if user[0] else "pedestrian" for user in here),
        length=size[:, 0],
        width=size[:, 1],
        history=whole[:, : HISTORY_STEPS + 1],
        recorded_steps=np.full(len(here), HISTORY_STEPS),
        future=whole[:, HISTORY_STEPS + 1 :],
        future_valid=np.stack([times[HISTORY_STEPS + 1 :] <= user[1][-1] for user in here]),
    )
    moves = scene.now.speed[:, None] * np.ones(len(TIME_S))
    lines = Lines.straight(scene.now, 200.0)
    return Expected(scene=scene, vehicles=vehicles, lines=lines, s=moves * TIME_S, speed=moves)


def collected(
    data: Path, cache: Path, *, every_s: float, part: int, parts: int
) -> Iterator[tuple[str, Samples]]:
    """Yield name and samples of recordings, kept in a folder; every so many of them from a part on."""
    cache.mkdir(parents=True, exist_ok=True)
    for recording in find_recordings([data])[part::parts]:
        file, motions = (cache / f"{recording.name}.{end}" for end in ("npz", "pickle"))
        if not motions.is_file():
            motions.write_bytes(dumps(expected_of(load_recording(recording), every_s)))
        if not file.is_file():
            found = [part for one in loads(motions.read_bytes()) if (part := samples_of(one, every_s))]
            if not found:
                continue
            Samples.joined(found).save(file)
        yield recording.name, Samples.read(file)
