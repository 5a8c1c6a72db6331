"""Near misses of recordings against P of pairs, and against simple rivals at the same moments.

    python benchmarks/near_misses.py DATA [--part test validation] [--every 3] [--futures 16] [--most N]

All pairs within 35 m at a moment without doubts, both recorded for 3 s more. A near miss then: PET < 1 s
at 30° or more, both faster than 3 m/s; or TTC < 1.5 s on the recorded ways, faster than 3 m/s, braking with
2 m/s². Rivals: 1/TTC, needed braking, PET and least gap at constant turn rate and speed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from sklearn.metrics import average_precision_score, roc_auc_score

from scex_sumo import find_recordings, load_recording, recording_moments, seed_at
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ScexError
from scex_sumo.conflicts.braking import DrivenPaths, needed_braking, shared_stretches
from scex_sumo.conflicts.pairs import NEAR_M, Conflicts, find_conflicts, least_braking, time_margins
from scex_sumo.decision.law import law, over_futures
from scex_sumo.decision.moment import human_part
from scex_sumo.evaluation.split import Split, split_moments
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.results.participants import everybody
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.roads.doubts import doubts_of
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

STEPS = 30
PET_S, TTC_S, SLOW_MPS, BRAKES_MPS2 = 1.0, 1.5, 3.0, -2.0
DATASETS = ("interaction", "taf_bw", "ngsim", "mona")
LIMITS = (0.5, 1.0, 1.5, 2.0, 3.0)
MARGINS = (0.5, 1.0, 1.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """Pairs (n,) of a moment, and what human-like futures (n, C) and the recording came to.

    Attributes:
        contact: P in each future; ``braking``, ``margin`` and ``gap`` of each.
        along: whether one follows the other, or merges.
        recorded: rows of the recording.
        speed: of the vehicle that brakes there, at the moment, m/s.
        rivals: scores by name.
    """

    km: float
    near_miss: BoolArray
    contact: FloatArray
    braking: FloatArray
    margin: FloatArray
    gap: FloatArray
    along: BoolArray
    recorded: Conflicts
    speed: FloatArray
    rivals: dict[str, FloatArray]
    names: list[str]


def moments_of(data: Path, parts: Sequence[str], every_s: float) -> Iterator[SeedScene]:
    """Yield seed scenes of parts of the recordings' time that are recorded for 3 s more."""
    for recording in find_recordings([data / name for name in DATASETS if (data / name).exists()]):
        loaded = load_recording(recording)
        moments = recording_moments(loaded, every_s=STEP_S)
        last_s, kept = moments[-1].time_s - STEPS * STEP_S, -np.inf
        split = split_moments(moments, Split())
        for moment in (one for part in parts for one in split[part]):  # type: ignore[index]
            if (
                moment.vehicles > 1
                and moment.time_s <= last_s
                and abs(moment.time_s - kept) >= every_s - 1e-6
            ):
                kept = moment.time_s
                try:
                    yield seed_at(loaded, moment.time_s)
                except ScexError:
                    continue


def sample_of(scene: SeedScene, futures: int) -> Sample | None:
    """Measure a moment; None without a pair that counts."""
    assert scene.road is not None and scene.future is not None and scene.future_valid is not None
    whole = scene.future_valid[:, :STEPS].all(axis=1) & (scene.recorded_steps >= HISTORY_STEPS)
    if scene.future.shape[1] < STEPS or whole.sum() < 2:
        return None
    with TemporaryDirectory() as folder:
        net = converted(scene.road, Path(folder) / "road.net.xml")
        scene, net = ruled(scene, net, RunSettings())
        part = human_part(scene, net, futures=futures)
    assert part.conflicts is not None
    found = rows_in(Conflicts, part.conflicts)
    found = found.take(found.two < scene.vehicles)  # without people
    one, two = _pairs(scene, whole)
    if not len(one):
        return None
    key = found.one * scene.vehicles + found.two
    rows = {int(k): np.flatnonzero(key == k) for k in np.unique(key)}
    shape = len(one), futures
    contact, braking, gap = np.zeros(shape), np.zeros(shape), np.full(shape, np.inf)
    margin, meets = np.full(shape, np.inf), np.full(shape, np.inf)
    p = law().contact(found, everybody(scene).types)
    for k, pair in enumerate((one * scene.vehicles + two).tolist()):
        own = rows.get(pair, np.zeros(0, np.int64))
        at = k, found.future[own]
        contact[at], braking[at], gap[at] = p[own], found.braking[own], found.gap[own]
        margin[at], meets[at] = found.margin[own], found.meets_rad[own]
    recorded = States.concatenate([scene.history, scene.future[:, :STEPS]], axis=1)
    there = np.unique(np.concatenate([one, two]))
    place = np.full(scene.vehicles, -1)
    place[there] = np.arange(len(there))
    really = find_conflicts(
        recorded[there].swapaxes(0, 1)[None], scene.length[there], scene.width[there], now=HISTORY_STEPS
    )
    order = rows_of(really.one, really.two, place[one], place[two])
    speed = recorded.speed[whole, HISTORY_STEPS:]
    return Sample(
        km=float(speed.sum()) * STEP_S / 1000,
        near_miss=_near_misses(scene, recorded, one, two),
        contact=contact,
        braking=braking,
        margin=margin,
        gap=gap,
        along=meets.min(axis=1) < np.pi / 6,
        recorded=really.take(order),
        speed=scene.now.speed[np.where(really.brakes_one[order], one, two)],
        rivals=_rivals(scene, one, two),
        names=[
            f"{scene.name} {a} {b}" for a, b in zip(scene.track_ids[one], scene.track_ids[two], strict=True)
        ],
    )


def _pairs(scene: SeedScene, whole: BoolArray) -> tuple[IntArray, IntArray]:
    one, two = np.triu_indices(scene.vehicles, 1)
    now = scene.now
    near = np.hypot(now.x[one] - now.x[two], now.y[one] - now.y[two]) < NEAR_M
    rows = np.flatnonzero(near & whole[one] & whole[two])
    doubts = doubts_of(scene, one[rows], two[rows])
    rows = rows[[doubt is None for doubt in doubts]]
    return one[rows], two[rows]


def _near_misses(scene: SeedScene, recorded: States, one: IntArray, two: IntArray) -> BoolArray:
    ways = DrivenPaths.of(recorded, scene.length, scene.width, None)
    margins = time_margins(ways, one, two, now=HISTORY_STEPS)
    later, earlier = np.where(margins.own_is_later, [one, two], [two, one])
    before = np.maximum(margins.step - np.rint(np.minimum(margins.margin, 9.0) / STEP_S).astype(int), 0)
    slow = np.minimum(recorded.speed[later, margins.step], recorded.speed[earlier, before])
    near = (margins.margin < PET_S) & (slow > SLOW_MPS)
    steps = np.arange(HISTORY_STEPS, recorded.shape[1])
    slows = (recorded.speed[:, 3:] - recorded.speed[:, :-3]) / (3 * STEP_S)
    brakes = slows[:, HISTORY_STEPS - 3 :].min(axis=1) <= BRAKES_MPS2
    number = {pair: k for k, pair in enumerate(zip(one.tolist(), two.tolist(), strict=True))}
    for side in shared_stretches(ways, one, two):
        needed = needed_braking(ways, side, np.zeros_like(recorded.speed), steps)
        for k, (own, other) in enumerate(zip(side.own.tolist(), side.other.tolist(), strict=True)):
            # v² / 2s = v / 2 TTC for a standing one; of a moving one the closing speed takes the place of v
            closing = recorded.speed[own, steps]
            short = (needed[k] > 0) & (needed[k] < 20) & (closing > SLOW_MPS)
            short &= ttc_on_ways(ways, side.enter[k], side.leave[k], own, other, steps) < TTC_S
            pair = number[min(own, other), max(own, other)]
            near[pair] |= bool(short.any() and brakes[own])
    return np.asarray(near)


def ttc_on_ways(
    ways: DrivenPaths, enter: FloatArray, leave: FloatArray, own: int, other: int, steps: IntArray
) -> FloatArray:
    """Return (S,) time to collision of two vehicles that keep their speeds and ways, s; inf: none."""
    t = np.arange(0.05, 3.0, 0.05)
    arc = ways.arc[other, steps][:, None] + ways.states.speed[other, steps][:, None] * t
    node = np.clip(np.rint(arc / ways.spacing[other]), 0, len(enter) - 1).astype(np.int64)
    way = ways.arc[own, steps][:, None] + ways.states.speed[own, steps][:, None] * t
    ahead = enter[node] > ways.arc[own, steps][:, None]
    hit = ahead & (way >= enter[node]) & (way <= leave[node])
    return np.where(hit, t, np.inf).min(axis=1)


def _rivals(scene: SeedScene, one: IntArray, two: IntArray) -> dict[str, FloatArray]:
    past = scene.history
    turn = np.angle(np.exp(1j * (past.heading[:, -1] - past.heading[:, -6]))) / (5 * STEP_S)
    turn = np.where(past.speed[:, -1] > 1, np.clip(turn, -1, 1), 0.0)[:, None]
    t, speed = STEP_S * np.arange(1, STEPS + 1), past.speed[:, -1:]
    heading = past.heading[:, -1:] + turn * (t - STEP_S / 2)
    ahead = States(
        x=past.x[:, -1:] + np.cumsum(speed * np.cos(heading) * STEP_S, axis=1),
        y=past.y[:, -1:] + np.cumsum(speed * np.sin(heading) * STEP_S, axis=1),
        heading=past.heading[:, -1:] + turn * t,
        speed=np.repeat(speed, STEPS, axis=1),
    )
    boxes = [Rectangles.of(ahead[v], scene.length[v, None], scene.width[v, None]) for v in (one, two)]
    gap = rectangle_distance(*boxes)
    hit = gap <= 0
    ttc = np.where(hit.any(axis=1), STEP_S * (1 + np.argmax(hit, axis=1)), np.inf)
    ways = DrivenPaths.of(States.concatenate([past, ahead], axis=1), scene.length, scene.width, None)
    braking = np.zeros(len(one))
    own, other = shared_stretches(ways, one, two)
    still, now = np.zeros_like(ways.states.speed), np.array([HISTORY_STEPS])
    each = least_braking(*(needed_braking(ways, side, still, now)[:, 0] for side in (own, other)))
    braking[rows_of(one, two, own.own, own.other)] = each
    pet = time_margins(ways, one, two, now=HISTORY_STEPS).margin
    return {
        "1/TTC": 1 / ttc,
        "needed braking": braking,
        "PET": -np.minimum(pet, 10.0),
        "least gap": -gap.min(axis=1),
    }


def rows_of(one: IntArray, two: IntArray, a: IntArray, b: IntArray) -> IntArray:
    """Return the rows of pairs (a, b) among pairs (one, two)."""
    number = {frozenset(pair): k for k, pair in enumerate(zip(one.tolist(), two.tolist(), strict=True))}
    return np.array([number[frozenset(pair)] for pair in zip(a.tolist(), b.tolist(), strict=True)], np.int64)


def scores(truth: BoolArray, score: FloatArray) -> str:
    """ROC area, average precision, and near misses among the first 20 and 50."""
    order = np.argsort(-score, kind="stable")
    found = f"{truth[order[:20]].sum():3d} {truth[order[:50]].sum():3d}"
    return f"{roc_auc_score(truth, score):.3f}  {average_precision_score(truth, score):.3f}  {found}"


def report(samples: Sequence[Sample]) -> None:
    """Print the table of scores, and sums of forecasts against counts."""
    truth = np.concatenate([one.near_miss for one in samples])
    contact = np.concatenate([one.contact for one in samples])
    futures = contact.shape[1]
    print(f"{len(samples)} moments, {len(truth)} pairs, {truth.sum()} near misses")
    print(f"{'score':<24}ROC    AP     first 20, 50")
    for count in sorted({4, 8, futures}):
        pair = np.arange(len(contact)).repeat(count)
        p = over_futures(pair, contact[:, :count].ravel(), pairs=len(contact), futures=count)
        print(f"{f'P, {count} futures':<24}{scores(truth, p)}")
    for name in samples[0].rivals:
        print(f"{name:<24}{scores(truth, np.concatenate([one.rivals[name] for one in samples]))}")
    along = np.concatenate([one.along for one in samples])
    braking = np.concatenate([one.braking for one in samples])
    really = np.concatenate([one.recorded.braking for one in samples])
    for what, rows in (("one follows", along), ("others", ~along)):
        each = (
            f"> {u:g}: {(braking[rows] > u).mean(axis=1).sum():.1f} / {(really[rows] > u).sum()}"
            for u in LIMITS
        )
        print(f"needed braking in 3 s, forecast / counted, {what}: {', '.join(each)}")
    margin = np.concatenate([one.margin for one in samples])
    real = np.concatenate([one.recorded.margin for one in samples])
    each = (f"< {u:g}: {(margin < u).mean(axis=1).sum():.1f} / {(real < u).sum()}" for u in MARGINS)
    print(f"time margin in 3 s, forecast / counted: {', '.join(each)}")
    hours = len(samples) * STEPS * STEP_S / 3600
    pair = np.arange(len(contact)).repeat(futures)
    p = over_futures(pair, contact.ravel(), pairs=len(contact), futures=futures)
    gap = np.concatenate([one.gap for one in samples])
    km = sum(one.km for one in samples)
    print(f"contacts expected: {p.sum() / hours:.3f} an hour, {p.sum() / km:.1e} a vehicle-km")
    print(f"share of futures with a contact, as it is: {(gap <= 0).mean(axis=1).sum() / km:.1e} a vehicle-km")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--part", nargs="+", default=["validation", "test"])
    parser.add_argument("--every", type=float, default=3.0)
    parser.add_argument("--futures", type=int, default=16)
    parser.add_argument("--most", type=int, default=None, help="moments, evenly thinned")
    options = parser.parse_args()
    scenes = list(moments_of(options.data, options.part, options.every))
    if options.most is not None and len(scenes) > options.most:
        scenes = [scenes[k] for k in np.linspace(0, len(scenes) - 1, options.most).astype(int)]
    measured = (sample_of(scene, options.futures) for scene in scenes)
    report([one for one in measured if one is not None])


if __name__ == "__main__":
    main()
