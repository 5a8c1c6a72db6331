"""Rules of the road against recordings and SUMO: starts, order of passing, gaps, entries at red, collisions.

    python benchmarks/rules.py recorded [--data FOLDER] [--sites NAMES] [--part test] [--every 20] [--most 20]
    python benchmarks/rules.py simulated SIM.sumocfg ... [--times 100,160,220] [--steps 50]
    python benchmarks/rules.py grids FOLDER [--first 1]
    python benchmarks/rules.py rest --part train --every 10 --most 1000
    python benchmarks/rules.py order --every 5 --most 60 --steps 50 [--sites NAMES]
    python benchmarks/rules.py violations --sites NAMES --most 8 --futures 128

``violations`` counts pairs that collide only if a violation is added to the default mix, beside those that as
many new futures of the default mix find. ``rest`` fits the gaps at which vehicles rest
behind each other: log mean and deviation.

``grids`` writes for ``simulated`` four signalised grids with random trips (netgenerate, seeds from
``--first``), and two of SUMO's tutorials with lights. Columns:

- error: of the futures' mean after 3 s (and at the end), against constant velocity's; all vehicles, moving;
- across: share of moving vehicles within 5-95 % across the road after 3 s;
- starts: standing vehicles that move more than 1 m in 3 s, share within 5-95 % along the road, and number;
- wrong: share of futures in which a vehicle that stays moves more than 1 m;
- order: share of pairs at a place that both pass, 0.5 s apart or more, whose order is forecast right; Brier
  scores of the order by the futures, by "the nearest goes first", and by way / speed (``soonest``); ``order``
  measures these alone, in moments with such pairs;
- gap: mean P that two bodies come nearer than 1 m, and how often they did;
- P(coll): mean share of futures with a collision; red: of those, collisions of a vehicle that entered at red.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import sumolib
from recorded_scenes import INTERACTION, INTERACTION_SITES

from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.drivers.registry import DEFAULT_MODELS, parse_models
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Split, split_moments
from scex_sumo.extrapolation.job import ruled, run_in_memory
from scex_sumo.extrapolation.loop.measure import measure_recorded
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.geometry.rectangles import seen_from
from scex_sumo.humans import obedience
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.studies.validate.scores import covered

STANDING_MPS, STARTED_M, CLOSE_M, FIRST_STEPS = 0.5, 1.0, 1.0, 30
MEET_M, APART_M, LEAST_STEPS, PASSED_M = 1.5, 4.0, 5, 2.5  # of centres of vehicles that pass one place
RESTS_MPS, QUEUE_M, QUEUE_COS, MOST_REST_M = 0.3, 1.2, 0.92, 6.0  # vehicles in one queue, and their gap
# "TraCI4Traffic Lights" (with its fixed programme) and "TraCIPedCrossing" of SUMO's documentation.
ARMS = {"w": (-500, 0), "e": (500, 0), "s": (0, -500), "n": (0, 500)}
TUTORIALS = {
    "cross": (
        {
            "n.nod.xml": "<nodes><node id='c' x='0' y='0' type='traffic_light'/>"
            + "".join(f"<node id='{k}' x='{x}' y='{y}'/>" for k, (x, y) in ARMS.items())
            + "</nodes>",
            "n.edg.xml": "<edges>"
            + "".join(
                f"<edge id='{k}i' from='{k}' to='c' speed='19.44'/>"
                f"<edge id='{k}o' from='c' to='{k}' speed='11.11'/>"
                for k in ARMS
            )
            + "</edges>",
            "demand.rou.xml": "<routes><vType id='we' accel='0.8' maxSpeed='16.67'/>"
            "<vType id='ns' accel='0.8' maxSpeed='25' length='7' minGap='3'/>"
            "<flow id='r' type='we' from='wi' to='eo' begin='0' end='300' probability='0.1'/>"
            "<flow id='l' type='we' from='ei' to='wo' begin='0' end='300' probability='0.09'/>"
            "<flow id='d' type='ns' from='ni' to='so' begin='0' end='300' probability='0.033'/></routes>",
        },
        "--tls.green.time 31 --tls.yellow.time 6",
    ),
    "crossing": (
        {
            "n.nod.xml": "<nodes><node id='w' x='-500' y='0'/><node id='c' x='0' y='0' type='traffic_light'/>"
            "<node id='e' x='500' y='0'/></nodes>",
            "n.edg.xml": "<edges>"
            + "".join(
                f"<edge id='{a}{b}' from='{a}' to='{b}' numLanes='3' speed='13.9' sidewalkWidth='3'/>"
                for a, b in ("wc", "ce", "ec", "cw")
            )
            + "</edges>",
            "n.con.xml": "<connections><crossing node='c' edges='wc cw' priority='1'/></connections>",
            "demand.rou.xml": "<routes><flow id='r' from='wc' to='ce' begin='0' end='300' period='4'/>"
            "<flow id='l' from='ec' to='cw' begin='0' end='300' period='5'/>"
            "<personFlow id='p' begin='0' end='300' period='10'><walk from='wc' to='cw'/></personFlow>"
            "</routes>",
        },
        "-x n.con.xml --tls.green.time 20",
    ),
}
COLUMNS = ("scenes", "vehicles", "error", "error end", "moving", "across", "starts", "n", "wrong", "order",
           "pairs", "brier", "nearest", "soonest", "gap", "happened", "P(coll)", "red")  # fmt: skip
ORDERS = ("order", "pairs", "brier", "nearest", "soonest")


def futures_of(
    scene: SeedScene, models: str, futures: int, steps: int, rules: bool, seed: int = 0
) -> tuple[SeedScene, object]:
    """The scene with its rules, and the futures of a mix of models in a world without SUMO."""
    settings = RunSettings(
        models=models, futures=futures, steps=steps, seed=seed, world="plain", rules=rules, metrics="gap"
    )
    assert scene.road is not None
    with tempfile.TemporaryDirectory() as folder:
        scene, net = ruled(scene, converted(scene.road, Path(folder) / "road.net.xml"), settings)
        return scene, run_in_memory(scene, net, settings, ModelSet.of(settings))


def recorded(arguments: argparse.Namespace) -> Iterator[tuple[str, SeedScene]]:
    """Moments of a part of the recordings of each site, evenly spread over them."""
    for site in arguments.sites.split(","):
        folder = INTERACTION / site if site in INTERACTION_SITES else Path("taf_bw")
        chosen: list[tuple[object, float]] = []
        for recording in find_recordings([arguments.data / folder]):
            if site not in recording.name:
                continue
            loaded, last = load_recording(recording), -np.inf
            moments = recording_moments(loaded, every_s=STEP_S)
            if arguments.part != "all":
                moments = split_moments(moments, Split())[arguments.part]
            for moment in moments:
                if moment.complete and moment.vehicles > 1 and moment.time_s >= last + arguments.every - 1e-6:
                    last = moment.time_s
                    chosen.append((loaded, last))
        left = arguments.most
        for k in np.random.default_rng(0).permutation(len(chosen)).tolist():
            try:
                scene = seed_at(*chosen[k])
            except ScexError as error:
                print(error, file=sys.stderr)
                continue
            passes = any(True for _ in passings(scene, arguments.steps))
            if arguments.what == "order" and not passes:
                continue
            if left and (not arguments.telling or passes or starts(scene)):
                left -= 1
                yield site, scene


def starts(scene: SeedScene) -> bool:
    """Whether a vehicle starts."""
    k = FIRST_STEPS - 1
    way = np.hypot(scene.future.x[:, k] - scene.now.x, scene.future.y[:, k] - scene.now.y)
    moves = (scene.now.speed <= STANDING_MPS) & (way > STARTED_M)
    return bool((moves & scene.future_valid[:, : k + 1].all(axis=1)).any())


def measure_order(scene: SeedScene, states, steps: int, into: dict[str, list]) -> None:
    """Add the order of pairs that pass one place to the figures of a site."""
    for a, b, place, first, nearest, soonest in passings(scene, steps):
        times = [_passes(states, v, place) for v in (a, b)]
        p = float(np.where(times[0] == times[1], 0.5, times[0] < times[1]).mean())
        into["order"].append((p > 0.5) == first)
        into["brier"].append((p - first) ** 2)
        into["nearest"].append((nearest - first) ** 2)
        into["soonest"].append((soonest - first) ** 2)


def measure(scene: SeedScene, arguments: argparse.Namespace, into: dict[str, list]) -> None:
    """Add the figures of a moment to those of its site."""
    scene, found = futures_of(
        scene, arguments.models, arguments.futures, arguments.steps, not arguments.no_rules
    )
    _, straight = futures_of(scene, "constant_velocity", 1, arguments.steps, False)
    states, future, valid = found.states, scene.future, scene.future_valid
    into["vehicles"].append(scene.vehicles)
    stands = scene.now.speed <= STANDING_MPS
    for name, k in (("", FIRST_STEPS - 1), ("_end", arguments.steps - 1)):
        known = valid[:, : k + 1].all(axis=1)
        for kind, of in (("error", states), ("straight", straight.states)):
            error = np.hypot(*(getattr(of, a)[:, k].mean(axis=0) - getattr(future, a)[:, k] for a in "xy"))
            into[kind + name] += error[known].tolist()
            into[kind + "_moving" + name] += error[known & ~stands].tolist()
    k = FIRST_STEPS - 1
    known = valid[:, : k + 1].all(axis=1)
    dx, dy = (getattr(states, a)[:, k] - getattr(future, a)[:, k] for a in "xy")
    cos, sin = np.cos(future.heading[:, k]), np.sin(future.heading[:, k])
    way = np.hypot(future.x[:, k] - scene.now.x, future.y[:, k] - scene.now.y)
    went = np.hypot(states.x[:, k] - scene.now.x, states.y[:, k] - scene.now.y) > STARTED_M
    for v in np.flatnonzero(known).tolist():
        if not stands[v]:
            into["across"].append(covered((cos * dy - sin * dx)[:, v] + 0.0, 0.0))
        elif way[v] > STARTED_M:
            into["starts"].append(covered((cos * dx + sin * dy)[:, v] + 0.0, 0.0))
        else:
            into["wrong"].append(went[:, v].mean())
    measure_order(scene, states, arguments.steps, into)
    settings = RunSettings(futures=1, metrics="gap")
    real = measure_recorded(scene, arguments.steps, metrics=settings.measured)
    if real is not None and (least := real.values.values[0, 0]) >= 0:
        into["gap"].append(float((found.values[:, 0] < CLOSE_M).mean()))
        into["happened"].append(float(least < CLOSE_M))
    hits = found.collisions.to_pylist()
    into["P(coll)"].append(len({h["future"] for h in hits}) / arguments.futures)
    red = entered_at_red(scene, states)
    index = {int(track): v for v, track in enumerate(scene.track_ids)}
    into["red"] += [
        red[h["future"], index[h["track_id"]]] != red[h["future"], index[h["other_id"]]]
        for h in hits
        if h["other_id"] in index
    ]


def passings(scene: SeedScene, steps: int) -> Iterator[tuple[int, int, np.ndarray, bool, float, float]]:
    """Pairs that cross or merge in the recorded future: indices, place, whether the first passes first.

    At the end whether it is nearer, and whether it comes sooner by its way and speed.
    """
    whole = np.flatnonzero(scene.future_valid[:, :steps].all(axis=1)).tolist()
    x, y = (np.column_stack([getattr(scene.now, a), getattr(scene.future, a)[:, :steps]]) for a in "xy")
    points = np.stack([x, y], axis=-1)
    for a, b in ((a, b) for a in whole for b in whole if a < b):
        apart = np.hypot(*(points[a][:, None] - points[b]).transpose(2, 0, 1))
        if apart.min() > MEET_M or min(apart[0].min(), apart[:, 0].min()) < APART_M:
            continue
        close = np.argwhere(apart < MEET_M)
        i, j = close[close.sum(axis=1).argmin()]
        if abs(i - j) >= LEAST_STEPS:
            place = (points[a, i] + points[b, j]) / 2
            ways = [np.hypot(*(points[v, 0] - place)) for v in (a, b)]
            soon = [way / max(float(scene.now.speed[v]), 0.1) for v, way in zip((a, b), ways, strict=True)]
            yield a, b, place, bool(i < j), float(ways[0] < ways[1]), float(soon[0] < soon[1])


def _passes(states, v: int, place: np.ndarray) -> np.ndarray:
    away = np.hypot(states.x[:, :, v] - place[0], states.y[:, :, v] - place[1])
    k = away.argmin(axis=1)
    return np.where((away.min(axis=1) < PASSED_M) & (k < away.shape[1] - 1), k, np.inf)


def entered_at_red(scene: SeedScene, states) -> np.ndarray:
    """Whether each vehicle of each future crosses the begin of a passage while its light is red, (C, V)."""
    result = np.zeros(states.x.shape[::2], dtype=bool)
    fronts = []
    for axis, of in (("x", np.cos), ("y", np.sin)):
        now = getattr(scene.now, axis) + scene.length / 2 * of(scene.now.heading)
        later = getattr(states, axis) + scene.length / 2 * of(states.heading)
        fronts.append(np.concatenate([np.broadcast_to(now, later[:, :1].shape), later], axis=1))
    for passage in scene.rules.passages if scene.rules is not None else ():
        if passage.signal < 0:
            continue
        begin, way = passage.line[0], passage.line[1] - passage.line[0]
        cos, sin = way / np.hypot(*way)
        dx, dy = fronts[0] - begin[0], fronts[1] - begin[1]
        along, across = cos * dx + sin * dy, np.abs(cos * dy - sin * dx)
        crosses = (along[:, :-1] < 0.7) & (along[:, 1:] >= 0.7) & (across[:, 1:] < 1.0)
        for c, t, v in zip(*np.nonzero(crosses), strict=True):
            if scene.rules.signals[passage.signal].at(t * STEP_S)[0] in "rR":
                result[c, v] = True
    return result


def table(rows: dict[str, dict[str, list]], columns: tuple[str, ...] = COLUMNS) -> str:
    """The figures of each site."""
    lines = [f"{'site':26}" + "".join(f"{name:>10}" for name in columns)]
    for site, of in rows.items():
        mean = defaultdict(lambda: np.nan) | {name: np.mean(values) for name, values in of.items() if values}
        row = mean | {
            "scenes": len(of["vehicles"]),
            "vehicles": sum(of["vehicles"]),
            "error": mean["error"] / mean["straight"],
            "error end": mean["error_end"] / mean["straight_end"],
            "moving": mean["error_moving"] / mean["straight_moving"],
            "n": len(of["starts"]),
            "pairs": len(of["order"]),
            "red": sum(of["red"]),
        }
        cells = (row.get(name, np.nan) for name in columns)
        lines.append(
            f"{site:26}" + "".join(f"{x:10d}" if isinstance(x, int) else f"{x:10.3f}" for x in cells)
        )
    return "\n".join(lines)


def violations(chosen: Iterator[tuple[str, SeedScene]], futures: int, steps: int) -> None:
    """Print the pairs that collide in futures of the default mix, and those that each violation adds."""
    plain, names = parse_models(DEFAULT_MODELS), ("runs_red", "ignores_priority", "cuts_in", "drifts")
    mixes = {"default": DEFAULT_MODELS} | {name: f"{DEFAULT_MODELS},{name}@{len(plain)}" for name in names}
    found: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(("moments", "found", *mixes), 0))
    for site, scene in chosen:
        first, *others = (
            {frozenset((h["track_id"], h["other_id"])) for h in rollout.collisions.to_pylist()}
            for mix, seed in ((DEFAULT_MODELS, 0), *((mix, 1) for mix in mixes.values()))
            for rollout in [futures_of(scene, mix, futures, steps, True, seed)[1]]
        )
        for name, count in zip(
            ("moments", "found", *mixes), (1, len(first), *(len(o - first) for o in others)), strict=True
        ):
            found[site][name] += count
    for site, row in found.items():
        print(f"{site:26}" + "".join(f"{name:>18}{count:5}" for name, count in row.items()))


def gaps_at_rest(scene: SeedScene, steps: int) -> list[float]:
    """Gaps of vehicles that rest behind another one at the end of the recorded future, m."""
    last, valid = scene.future[:, steps - 1], scene.future_valid[:, steps - 1]
    found = []
    for v in np.flatnonzero(valid & (last.speed < RESTS_MPS)).tolist():
        ahead, left, cos, *_ = seen_from(last[v], last).T
        leads = valid & (last.speed < RESTS_MPS) & (ahead > 0) & (np.abs(left) < QUEUE_M) & (cos > QUEUE_COS)
        leads[v] = False
        gap = (ahead - (scene.length[v] + scene.length) / 2)[leads].min(initial=np.inf)
        if 0 < gap < MOST_REST_M:
            found.append(float(gap))
    return found


def write_simulations(folder: Path, first_seed: int) -> None:
    """Write four signalised grids with trips, and two of SUMO's tutorials with lights."""
    home = Path(sumolib.__file__).parents[1] / "sumo"

    def call(program: str, place: Path) -> None:
        first, *rest = program.split()
        run = [f"{home}/bin/{first}"] if "." not in first else [sys.executable, f"{home}/tools/{first}"]
        subprocess.run([*run, *rest], cwd=place, check=True)

    grid = "netgenerate --grid --grid.number 3 --grid.length 150 -L 2 --turn-lanes 1 -o net.net.xml"
    for seed in range(first_seed, first_seed + 4):
        place = _simulation(folder / f"grid{seed}", "trips.trips.xml")
        call(f"{grid} --default-junction-type traffic_light --seed {seed}", place)
        trips = "randomTrips.py -n net.net.xml -o trips.trips.xml -e 300 -p 1.2 --fringe-factor 5"
        call(f"{trips} --seed {seed}", place)
    for name, (files, options) in TUTORIALS.items():
        place = _simulation(folder / name, "demand.rou.xml")
        for file, text in files.items():
            (place / file).write_text(text)
        call(f"netconvert -n n.nod.xml -e n.edg.xml -o net.net.xml {options}", place)


def _simulation(place: Path, demand: str) -> Path:
    """Make a folder with a configuration."""
    place.mkdir(parents=True, exist_ok=True)
    (place / "sim.sumocfg").write_text(
        f'<configuration><input><net-file value="net.net.xml"/><route-files value="{demand}"/></input>'
        '<time><begin value="0"/><end value="300"/><step-length value="0.1"/></time></configuration>'
    )
    return place


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("recorded", "simulated", "grids", "rest", "violations", "order"))
    parser.add_argument("files", nargs="*")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--sites", default=",".join(("k733", *INTERACTION_SITES[1:])))
    parser.add_argument("--part", default="test", choices=("train", "validation", "test", "all"))
    parser.add_argument(
        "--every", type=float, default=20.0, help="least time between moments of a recording, s"
    )
    parser.add_argument("--most", type=int, default=20, help="moments of each site")
    parser.add_argument("--telling", action="store_true", help="moments with starts, or passings, alone")
    parser.add_argument("--first", type=int, default=1, help="seed of the first grid")
    parser.add_argument("--times", default="100,160,220", help="moments of simulations, s")
    parser.add_argument("--models", default="likely_driver")
    parser.add_argument("--futures", type=int, default=16)
    parser.add_argument("--steps", type=int, default=FIRST_STEPS)
    parser.add_argument("--no-rules", action="store_true")
    parser.add_argument(
        "--with", dest="given", default="", help="rule parameters, e.g. gap_factor=0.6,gap_spread=0.3"
    )
    arguments = parser.parse_args()
    if arguments.what == "grids":
        return write_simulations(Path(arguments.files[0]), arguments.first)
    given = dict(pair.split("=") for pair in arguments.given.split(",") if pair)
    changed = {k: float(v) for k, v in given.items()}
    obedience.RULE_PARAMETERS = dataclasses.replace(obedience.RULE_PARAMETERS, **changed)
    if arguments.what == "rest":
        of: dict[str, list[float]] = defaultdict(list)
        for site, scene in recorded(arguments):
            of[site] += np.log(gaps_at_rest(scene, arguments.steps)).tolist()
        for site, logs in of.items():
            print(f"{site:26}{len(logs):6}{np.mean(logs):8.3f}{np.std(logs):8.3f}")
        weight = np.sqrt([len(logs) for logs in of.values()])
        mean, spread = (
            np.average([f(logs) for logs in of.values()], weights=weight) for f in (np.mean, np.std)
        )
        print(f"weighted by the root of vehicles: {mean:.2f}, {spread:.2f}")
        return
    if arguments.what == "violations":
        return violations(recorded(arguments), arguments.futures, arguments.steps)
    if arguments.what in ("recorded", "order"):
        chosen = recorded(arguments)
    else:
        chosen = (
            (Path(file).parent.name, read_seed(file, time=float(t)))
            for file in arguments.files
            for t in arguments.times.split(",")
        )
    rows: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    order = arguments.what == "order"
    for site, scene in chosen:
        if order:
            states = futures_of(
                scene, arguments.models, arguments.futures, arguments.steps, not arguments.no_rules
            )[1].states
            measure_order(scene, states, arguments.steps, rows[site])
        else:
            measure(scene, arguments, rows[site])
        print(site, scene.name, file=sys.stderr)
    whole: dict[str, list] = defaultdict(list)
    for of in rows.values():
        for name, values in of.items():
            whole[name] += values
    print(table(rows | {"all": whole}, ORDERS if order else COLUMNS))


if __name__ == "__main__":
    main()
