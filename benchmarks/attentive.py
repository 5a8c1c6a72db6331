"""Human-like futures against recordings and constant velocity, by site.

    python benchmarks/attentive.py [--data FOLDER] [--part test] [--most 5] [--futures 32] [--models likely]
                                   [--kept FILE] [--raw] [--no-rules] [--sites NAMES] [--steps 30]
                                   [--parameters FILE]

Seed scenes of the part of the time split are driven for 3 s (--steps) in a world without SUMO. Columns:

- brier, cv, base: mean Brier score of the paper's four events, of constant velocity, and of the base rate;
- cover, least: share of recorded values within 5-95 % of the futures, mean and smallest of the 24 values;
- P(coll): mean share of futures with a collision, where recorded boxes never overlap;
- error: position error of moving vehicles after 3 s (mean future) against that of constant velocity;
- along, across: share of moving vehicles within 5-95 % along and across the road after 3 s;
- starts: standing vehicles that move more than 1 m in 3 s, share within 5-95 %, and mean error, m;
- stands: mean error of the vehicles that stay, m;
- brake: share of vehicle-seconds with braking above 3 m/s² (over half a second), futures and recording, %.

Then events of pairs as of `validate`: sum of forecasts, count, constant velocity's count;
and 95 % intervals: the seed scenes of each row are drawn anew 1000 times.

``--kept`` keeps the seed scenes and their recorded values in a file, which makes later runs faster. ``--raw``
plans from recorded headings and speeds instead of estimated ones. ``--parameters`` reads a file of
``calibrate_likely.py``, e.g. one that is fitted without a site.
"""

from __future__ import annotations

import argparse
import os
import pickle
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from recorded_scenes import INTERACTION, INTERACTION_SITES, NGSIM_TEST

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Part, Split, split_moments
from scex_sumo.extrapolation.assignments import future_generator, route_draws
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.loop.measure import measure_outcome, measure_recorded, recorded_steps_of
from scex_sumo.extrapolation.loop.rollout import Batch, Rollout, roll_out
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.humans import driver
from scex_sumo.humans.guard.side_clearance import box_distances
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.metrics.events import MEASURED
from scex_sumo.scene import STEP_S, SeedScene, States
from scex_sumo.studies.validate.scores import brier, covered
from scex_sumo.studies.validate.scoring import COLLISION, EVENTS, MIN_DEFINED
from scex_sumo.studies.validate.vehicles import pair_forecasts
from scex_sumo.world.plain import PlainWorld

STEPS, REPLAN = 30, 5
HARD_MPS2, OVER_STEPS = 3.0, 5
STANDING_MPS, STARTED_M = 0.5, 1.0
SETTINGS = RunSettings(futures=1)
DATASETS = ("mona", "taf_bw", "ngsim", str(INTERACTION), "av2", "scenarionet")
UNSEEN = ("av2", "nuscenes")  # nothing of them is fitted to: test parts
SITES = (
    "MONA-East",
    "MONA-Merge",
    "MONA-West",
    "k729",
    "k733",
    "Lanker",
    "Peach",
    *INTERACTION_SITES,
    *UNSEEN,
)
COLUMNS = ("vehicles", "brier", "cv", "base", "cover", "least", "P(coll)", "error", "along", "across",
           "starts", "n", "bias", "stands", "brake", "rec")  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A seed scene, what happened, and constant velocity."""

    site: str
    scene: SeedScene
    recorded: FloatArray  # (K,) metric values and collision
    straight: FloatArray  # (K,)
    straight_states: States  # (1, T, V)
    recorded_pairs: Encounters
    straight_pairs: Encounters


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """Futures of one case, measured."""

    case: Case
    driven: FloatArray  # (C, K)
    pairs: Encounters
    states: States  # (C, T, V)


def site_of(name: str) -> str:
    return next(site for site in SITES if site.replace("-", "").lower() in name.replace("-", "").lower())


def cases(data: Path, part: Part, most: int, rules: bool) -> Iterator[Case]:
    """The seed scenes of each site, evenly thinned, at most some per site."""
    chosen: dict[str, list[tuple[object, float]]] = {}
    for recording in find_recordings([data / name for name in DATASETS if (data / name).exists()]):
        unseen = site_of(recording.name) in UNSEEN
        ngsim = site_of(recording.name) in ("Lanker", "Peach")
        test = unseen or any(file in recording.name for file in NGSIM_TEST)
        if (unseen or ngsim) and test != (part == "test"):
            continue
        loaded = load_recording(recording)
        moments = recording_moments(loaded, every_s=STEP_S)
        if unseen:
            moments = [m for m in moments if m.time_s <= moments[-1].time_s - STEPS * STEP_S]
        elif not ngsim:
            moments = split_moments(moments, Split())[part]
        moments = [m for m in moments if m.complete and m.vehicles > 1]
        if moments:
            chosen.setdefault(site_of(recording.name), []).extend((loaded, m.time_s) for m in moments[5::10])
    for site in SITES:
        found = chosen.get(site, [])
        step = max(1.0, len(found) / most)
        for k in range(min(most, len(found))):
            loaded, time_s = found[int(k * step + step / 2)]
            scene = seed_at(loaded, time_s)
            scene = with_rules(scene) if rules else scene
            yield case_of(site, scene)


def with_rules(scene: SeedScene) -> SeedScene:
    """The scene with the rules of the road, as a run has them."""
    assert scene.road is not None
    with tempfile.TemporaryDirectory() as folder:
        return ruled(scene, converted(scene.road, Path(folder) / "road.net.xml"), SETTINGS)[0]


def case_of(site: str, scene: SeedScene) -> Case:
    recorded = measure_recorded(scene, STEPS, metrics=SETTINGS.measured)
    assert recorded is not None
    values = np.where(recorded.values.defined, recorded.values.values, np.nan)
    distance = box_distances(scene) + np.diag(np.full(scene.vehicles, np.inf))
    overlap = (len(recorded.overlaps) > 0) | (distance.min() <= 0)
    real = np.append(values[0], overlap)
    straight = simulated(scene, "constant_velocity", range(1))
    straight_values, straight_pairs = measured(scene, straight)
    return Case(
        site=site,
        scene=scene,
        recorded=real,
        straight=straight_values[0],
        straight_states=straight.states,
        recorded_pairs=recorded.encounters,
        straight_pairs=straight_pairs,
    )


def simulated(scene: SeedScene, model: str, futures: range, seed: int = 0) -> Rollout:
    """Drive all vehicles of a seed scene by a model, in a world without SUMO."""
    road = scene.road
    assert road is not None
    count, one = len(futures), build(parse_models(model)[0])
    batch = Batch(
        futures=np.array(futures),
        assignment=np.zeros((count, scene.vehicles), dtype=np.int64),
        models=(one,),
        names=(model,),
        overridden=np.array([True]),
        route_draw=route_draws(futures, scene.vehicles, seed=seed),
        generators=[future_generator(seed, future) for future in futures],
    )
    return roll_out(PlainWorld(count, scene.vehicles), road, scene, batch, steps=STEPS, replan=REPLAN)


def measured(scene: SeedScene, rollout: Rollout) -> tuple[FloatArray, Encounters]:
    """(C, K) metric values and whether something collides; encounters."""
    counted = recorded_steps_of(scene, STEPS)
    found = measure_outcome(scene, rollout, metrics=SETTINGS.measured, counted=counted)
    values = np.where(found.values.defined, found.values.values, np.nan)
    hit = np.zeros(len(values))
    hit[found.collisions.future] = 1.0
    return np.concatenate([values, hit[:, None]], axis=1), found.encounters


def figures(case: Case, model: str, futures: int) -> Figures:
    rollout = simulated(case.scene, model, range(futures))
    driven, pairs = measured(case.scene, rollout)
    return Figures(case=case, driven=driven, pairs=pairs, states=rollout.states)


def row_of(found: list[Figures]) -> dict[str, float]:
    """The columns of the table for some cases."""
    names = [*SETTINGS.columns, COLLISION]
    real, straight = (np.stack([getattr(f.case, name) for f in found]) for name in ("recorded", "straight"))
    scores, plain, base = [], [], []
    for event in EVENTS:
        if event.paper:
            column = names.index(event.column)
            p = np.array([event.happened(f.driven[:, column]).mean() for f in found])
            o = event.happened(real[:, column])
            scores.append(brier(p, o))
            plain.append(brier(event.happened(straight[:, column]).astype(float), o))
            base.append(brier(np.full(len(o), o.mean()), o))
    cover = {}
    for column, name in enumerate(names[:-1]):
        hits = []
        for f in found:
            y, sample = f.case.recorded[column], f.driven[:, column]
            sample = sample[np.isfinite(sample)]
            if np.isfinite(y) and len(sample) >= MIN_DEFINED * len(f.driven):
                hits.append(covered(sample, float(y)))
        if hits:
            cover[name] = float(np.mean(hits))
    apart = real[:, -1] == 0
    moving, starts, stands, hard, hard_real = [], [], [], [], []
    for f in found:
        moving_rows, start_rows, stand_rows = positions(f)
        moving += moving_rows
        starts += start_rows
        stands += stand_rows
        drive, truth = braking(f)
        hard.append(drive)
        hard_real.append(truth)
    motion = np.array(moving).reshape(-1, 4)
    start = np.array(starts).reshape(-1, 2)
    return {
        "vehicles": sum(f.case.scene.vehicles for f in found),
        "brier": float(np.mean(scores)),
        "cv": float(np.mean(plain)),
        "base": float(np.mean(base)),
        "cover": float(np.mean(list(cover.values()))),
        "least": min(cover.values()),
        "worst": min(cover, key=lambda name: cover[name]),
        "P(coll)": 100
        * float(
            np.mean([f.driven[:, -1].mean() for f, a in zip(found, apart, strict=True) if a] or [np.nan])
        ),
        "error": float(motion[:, 0].mean() / motion[:, 1].mean()) if len(motion) else np.nan,
        "along": float(motion[:, 2].mean()) if len(motion) else np.nan,
        "across": float(motion[:, 3].mean()) if len(motion) else np.nan,
        "starts": float(start[:, 0].mean()) if len(start) else np.nan,
        "n": len(start),
        "bias": float(start[:, 1].mean()) if len(start) else np.nan,
        "stands": float(np.mean(stands)) if stands else np.nan,
        "brake": 100 * float(np.concatenate(hard).mean()),
        "rec": 100 * float(np.concatenate(hard_real).mean()),
    }


def positions(
    f: Figures,
) -> tuple[list[tuple[float, float, bool, bool]], list[tuple[bool, float]], list[float]]:
    """Errors after 3 s: of moving vehicles, of those that start from standing, and of those that stay."""
    scene, last = f.case.scene, STEPS - 1
    assert scene.future is not None and scene.future_valid is not None
    whole = scene.future_valid[:, :STEPS].all(axis=1)
    moving, starts, stands = [], [], []
    for v in np.flatnonzero(whole).tolist():
        x, y, heading = (float(a[v, last]) for a in (scene.future.x, scene.future.y, scene.future.heading))
        dx, dy = f.states.x[:, last, v] - x, f.states.y[:, last, v] - y
        along, across = (
            np.cos(heading) * dx + np.sin(heading) * dy,
            np.cos(heading) * dy - np.sin(heading) * dx,
        )
        plain = np.hypot(f.case.straight_states.x[0, last, v] - x, f.case.straight_states.y[0, last, v] - y)
        error = float(np.hypot(dx.mean(), dy.mean()))
        if scene.now.speed[v] > STANDING_MPS:
            moving.append((error, float(plain), covered(along, 0.0), covered(across, 0.0)))
        elif np.hypot(x - scene.now.x[v], y - scene.now.y[v]) > STARTED_M:
            way = float(np.mean(np.cos(heading) * dx + np.sin(heading) * dy))
            starts.append((covered(along, 0.0), way))
        else:
            stands.append(error)
    return moving, starts, stands


def braking(f: Figures) -> tuple[np.ndarray, np.ndarray]:
    """Whether each vehicle brakes hard at each step, in the futures and in the recording."""
    scene = f.case.scene
    assert scene.future is not None and scene.future_valid is not None
    known = np.cumprod(scene.future_valid[:, :STEPS], axis=1).astype(bool)[:, OVER_STEPS - 1 :]
    real = np.concatenate([scene.now.speed[:, None], scene.future.speed[:, :STEPS]], axis=1)
    drive = np.concatenate(
        [np.broadcast_to(scene.now.speed, f.states.x[:, :1].shape), f.states.speed], axis=1
    )
    limit = -HARD_MPS2 * OVER_STEPS * STEP_S
    hard_real = (real[:, OVER_STEPS:] - real[:, :-OVER_STEPS]) < limit
    hard = (drive[:, OVER_STEPS:] - drive[:, :-OVER_STEPS]) < limit
    return hard.swapaxes(1, 2)[:, known].ravel(), hard_real[known]


def near_misses(done: list[Figures]) -> str:
    """Return sums of forecast events of pairs, counts, and counts of constant velocity."""
    tables = []
    for f in done:
        scene = f.case.scene
        assert scene.future_valid is not None
        judged = np.asarray(scene.future_valid[:, :STEPS].all(axis=1))
        others = f.case.straight_pairs, f.case.recorded_pairs
        tables.append(pair_forecasts(scene, f.pairs, *others, judged, futures=len(f.driven)))
    whole, lines = pa.concat_tables(tables), []
    for event in MEASURED:
        p, o, cv = (
            np.asarray(whole[f"{event.name}_{what}"]).sum() for what in ("forecast", "happened", "straight")
        )
        lines.append(f"{event.words}: {p:.1f} / {o:.0f} / {cv:.0f}")
    return "\n".join(lines)


def intervals(found: list[Figures]) -> str:
    """Return 95 % intervals of error, along, across and starts over seed scenes that are drawn anew."""
    sums = []
    for f in found:
        moving, starts, _ = positions(f)
        within = sum(hit for hit, _ in starts)
        sums.append([*np.array(moving).reshape(-1, 4).sum(axis=0), len(moving), within, len(starts)])
    chosen = np.random.default_rng(0).integers(len(found), size=(1000, len(found)))
    error, plain, along, across, n, within, starts_n = np.array(sums, dtype=np.float64)[chosen].sum(axis=1).T
    with np.errstate(invalid="ignore"):
        ratios = {
            "error": error / plain,
            "along": along / n,
            "across": across / n,
            "starts": within / starts_n,
        }
    low_high = {name: np.quantile(ratio, [0.025, 0.975]) for name, ratio in ratios.items()}
    return ", ".join(f"{name} {low:.3f} to {high:.3f}" for name, (low, high) in low_high.items())


def table(rows: dict[str, dict[str, float]]) -> str:
    lines = [f"{'site':24}" + "".join(f"{name:>9}" for name in COLUMNS) + "  worst value"]
    for site, row in rows.items():
        cells = "".join(
            f"{row[name]:9.3f}" if isinstance(row[name], float) else f"{row[name]:9}" for name in COLUMNS
        )
        lines.append(f"{site:12}{cells}  {row['worst']}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--part", default="test", choices=("train", "validation", "test"))
    parser.add_argument("--most", type=int, default=5, help="seed scenes of each site")
    parser.add_argument("--futures", type=int, default=32)
    parser.add_argument("--models", default="likely")
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--raw", action="store_true", help="drivers plan from recorded headings and speeds")
    parser.add_argument("--no-rules", action="store_true", help="drivers without the rules of the road")
    parser.add_argument("--sites", default=",".join(SITES))
    parser.add_argument("--steps", type=int, default=STEPS, help="of 0.1 s; files of --kept have their own")
    parser.add_argument("--parameters", type=Path, help="of the human-like driver")
    arguments = parser.parse_args()
    if arguments.parameters is not None:
        human = HumanParameters.read(arguments.parameters)
        driver.human_parameters = lambda: human  # type: ignore[assignment]
    globals()["STEPS"] = arguments.steps
    if arguments.raw:
        driver.estimated_history = lambda history, road: history  # type: ignore[assignment]
    if arguments.kept is not None and arguments.kept.is_file():
        found = pickle.loads(arguments.kept.read_bytes())
    else:
        found = list(cases(arguments.data, arguments.part, arguments.most, not arguments.no_rules))
        if arguments.kept is not None:
            arguments.kept.write_bytes(pickle.dumps(found))
    begin = time.process_time()
    done = [
        figures(case, arguments.models, arguments.futures)
        for case in found
        if case.site in arguments.sites.split(",")
    ]
    sites = {site: [f for f in done if f.case.site == site] for site in SITES}
    groups = {site: part for site, part in sites.items() if part} | {"all": done}
    print(table({site: row_of(part) for site, part in groups.items()}))
    print(near_misses(done))
    for site, part in groups.items():
        print(f"{site}: {intervals(part)}")
    print(f"{len(done)} seed scenes, {arguments.futures} futures each, {time.process_time() - begin:.0f} s")


if __name__ == "__main__":
    main()
