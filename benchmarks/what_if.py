"""Futures of SUMO simulations against SUMO itself, from the same moment on and without random driving.

    python -m benchmarks.what_if [A.sumocfg ...] [--times 60,100] [--model sumo:own] [--own-step] [--closed]
    python -m benchmarks.what_if [A.sumocfg ...] [--times 60,100] --export

Without files: the ten of `benchmarks.simulations`, at steps of 0.1 s or at their own ones. The table has the
vehicles, the median and largest distance in m after 3 s and 8 s, vehicles that left the simulation but not
the future ("too many"), and the future but not the simulation ("missing"); then, of persons with
``--vru model``, their number, median and largest distance after 3 s. No future has the vehicles that SUMO
inserts after the moment: with ``--closed`` they are taken out of the simulation at once.

``--export`` replays ``export --to sumo`` of the future beside the closed simulation, for 60 s from its end:
road users, how many are exported, how many with the same route, seconds in which all lights are the same,
median and largest distance after 10 s, vehicles that brake harder than 4.5 m/s2 in the export alone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.simulations import ten_simulations

STEPS, AFTER = 80, (30, 80)
OPTIONS = ("--no-step-log", "--no-warnings", "--xml-validation", "never")
PRECISE = ("--save-state.transportables", "true", "--save-state.precision", "12")
STILL = ("--pedestrian.striping.dawdling", "0")
HARD_MPS2 = -4.6
COMPARED = ("Simulation", "vehicles", "3 s", "8 s", "too many", "missing", "persons")
EXPORTED = (
    "Simulation",
    "road users",
    "exported",
    "routes",
    "lights of 61",
    "10 s",
    "largest",
    "hard braking",
)
CHANGES = ("--lanechange.duration", "3")  # as in futures: lane changes take their time


def positions(sumo: Any, names: set[str]) -> dict[str, tuple[float, float]]:
    """Return (x, y) of the centre of each vehicle or person that is still there."""
    found = {}
    for domain in (sumo.vehicle, sumo.person):
        for name in names & set(domain.getIDList()):
            (x, y), heading = domain.getPosition(name), np.radians(90 - domain.getAngle(name))
            half = domain.getLength(name) / 2
            found[name] = (x - half * np.cos(heading), y - half * np.sin(heading))
    return {name: place for name, place in found.items() if abs(place[0]) < 1e8}


def compare(config: str, time_s: float, model: str, own_step: bool, closed: bool) -> None:
    """Print as JSON the distances after 3 s and 8 s, vehicles too many and missing, those of persons."""
    import libsumo as sumo

    import scex_sumo as scex

    warnings.simplefilter("ignore")
    text = Path(config).read_bytes()
    how = [*(() if own_step else ("--step-length", "0.1")), *STILL]
    sumo.start(
        ["sumo", "-c", config, *OPTIONS, *PRECISE, *how, *(() if b"lateral-resolution" in text else CHANGES)]
    )
    watch = scex.watch(sumo)
    while sumo.simulation.getTime() < time_s and sumo.simulation.getMinExpectedNumber():
        sumo.simulationStep()
    for name in sumo.vehicle.getIDList():
        sumo.vehicle.setImperfection(name, 0.0)
    run = watch.extrapolate(futures=1, models=model, steps=STEPS, reference="none")
    walking = [] if watch.scene().obstacles is None else [walked(watch, model)]
    off: list[list[float]] = []
    gone = [0, 0]
    begin = sumo.simulation.getTime()
    for steps in AFTER:
        while sumo.simulation.getTime() < begin + steps / 10 - 1e-6:
            sumo.simulationStep()
            for name in sumo.simulation.getDepartedIDList():
                sumo.vehicle.setImperfection(name, 0.0)
                if closed:
                    sumo.vehicle.remove(name)
        here = places(run, steps)
        there = positions(sumo, set(known(run).values()))
        off.append([float(np.hypot(*np.subtract(here[n], there[n]))) for n in here.keys() & there.keys()])
        gone = [gone[0] + len(here.keys() - there.keys()), gone[1] + len(there.keys() - here.keys())]
        if steps == AFTER[0]:
            people = [
                float(np.hypot(*np.subtract(places(one, steps)[n], there[n])))
                for one in walking
                for there in [positions(sumo, set(known(one).values()))]
                for n in (places(one, steps).keys() & there.keys()) - here.keys()
            ]
    print(json.dumps([*off, *gone, people]))


def replay_beside(config: str, time_s: float, model: str) -> None:
    """Print as JSON the comparison of an exported future with the simulation that goes on."""
    import libsumo as sumo

    import scex_sumo as scex
    from scex_sumo.exporters.request import EXPORTERS, Request

    warnings.simplefilter("ignore")
    changes = () if b"lateral-resolution" in Path(config).read_bytes() else CHANGES
    sumo.start(["sumo", "-c", config, "--step-length", "0.1", *OPTIONS, *PRECISE, *STILL, *changes])
    watch = scex.watch(sumo)
    while sumo.simulation.getTime() < time_s - 1e-6:
        sumo.simulationStep()
    for name in sumo.vehicle.getIDList():
        sumo.vehicle.setImperfection(name, 0.0)
    run = watch.extrapolate(futures=1, models=model, steps=AFTER[0], reference="none")
    for _ in range(AFTER[0]):
        closed_step(sumo)
    own = minute(sumo)
    sumo.close()
    with tempfile.TemporaryDirectory() as folder:
        (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=Path(folder)))
        sumo.start(["sumo", "-c", str(file), *OPTIONS, *STILL, *changes])
        exported = minute(sumo)
    (lights, routes, places, braking), (seen, ways, there, harder) = own, exported
    off = [float(np.hypot(*np.subtract(places[n], there[n]))) for n in places.keys() & there.keys()]
    same = sum(a == b for a, b in zip(lights, seen, strict=True))
    brakes = [n for n in harder if harder[n] < HARD_MPS2 <= braking.get(n, 0.0)]
    equal = sum(ways.get(name) == route for name, route in routes.items())
    print(json.dumps([len(routes), len(ways), equal, same, np.median(off), max(off), len(brakes)]))


def closed_step(sumo: Any) -> None:
    """Advance without the vehicles that are inserted."""
    sumo.simulationStep()
    for name in sumo.simulation.getDepartedIDList():
        sumo.vehicle.remove(name)


def minute(sumo: Any) -> tuple[list[Any], dict[str, Any], dict[str, Any], dict[str, float]]:
    """Return lights of each second, routes at the begin, places after 10 s, and hardest braking, m/s2."""
    lights: list[Any] = []
    places: dict[str, Any] = {}
    hardest: dict[str, float] = {}
    ask = sumo.vehicle
    routes = {v: ask.getRoute(v)[max(ask.getRouteIndex(v), 0) :][:40] for v in ask.getIDList()}
    routes |= {p: sumo.person.getEdges(p)[:-1] for p in sumo.person.getIDList()}
    for step in range(601):
        if step % 10 == 0:
            signals = sumo.trafficlight
            lights.append([signals.getRedYellowGreenState(light) for light in signals.getIDList()])
        if step == 100:
            places = {v: ask.getPosition(v) for v in ask.getIDList()}
        closed_step(sumo)
        for v in ask.getIDList():
            hardest[v] = min(hardest.get(v, 0.0), ask.getAcceleration(v))
    return lights, routes, places, hardest


def walked(watch: Any, model: str) -> Any:
    """Return a run in which persons walk by their models."""
    return watch.extrapolate(futures=1, models=model, steps=STEPS, reference="none", vru="model")


def known(run: Any) -> dict[int, str]:
    """Return SUMO's names by track id."""
    return {int(track): name for track, name in run.info["seed_scene"]["source"]["vehicles"].items()}


def places(run: Any, steps: int) -> dict[str, tuple[float, float]]:
    """Return (x, y) of the vehicles that are still in the future after some steps, by SUMO's name."""
    states, names = run.states(0)[:, steps - STEPS - 1], known(run)
    tracks = run.info["seed_scene"]["track_ids"]
    rows = zip(tracks, states.x.tolist(), states.y.tolist(), strict=True)
    return {names.get(track, str(track)): (x, y) for track, x, y in rows if np.isfinite(x)}


def main() -> None:
    """Print a row for each simulation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("configs", nargs="*", type=Path)
    parser.add_argument("--times", default="60,100,140")
    parser.add_argument("--model", default="sumo:own")
    parser.add_argument("--own-step", action="store_true")
    parser.add_argument("--closed", action="store_true")
    parser.add_argument("--export", action="store_true")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        config, at = given.one
        if given.export:
            return replay_beside(config, float(at), given.model)
        return compare(config, float(at), given.model, given.own_step, given.closed)
    columns = EXPORTED if given.export else COMPARED
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    with tempfile.TemporaryDirectory() as folder:
        for config in given.configs or ten_simulations(Path(folder)):
            print(row(config, given), flush=True)
    return None


def row(config: Path, given: argparse.Namespace) -> str:
    """Return the table's row of a simulation."""
    parts: list[Any] = []
    for at in given.times.split(","):
        one = ["-m", "benchmarks.what_if", "--one", str(config.resolve()), at, "--model", given.model]
        one += ["--own-step"] * given.own_step + ["--closed"] * given.closed
        one += ["--export"] * given.export
        done = subprocess.run([sys.executable, *one], capture_output=True, text=True, check=False)
        if done.returncode:
            return f"| {config.parent.name} | {at} s: {done.stderr.strip().splitlines()[-1]} |"
        parts.append(json.loads(done.stdout.splitlines()[-1]))
    if given.export:
        return "\n".join(
            f"| {config.parent.name} | {' | '.join(f'{x:.4g}' for x in part)} |" for part in parts
        )
    soon, late, people = ([value for part in parts for value in part[k]] for k in (0, 1, 4))
    name = config.parent.name if config.stem == "m" else config.stem
    told = [f"{np.median(values):.2f}, {max(values):.2f}" if values else "–" for values in (soon, late)]
    walk = f"{len(people)}: {np.median(people):.2f}, {max(people):.2f}" if people else "–"
    more, fewer = (sum(part[k] for part in parts) for k in (2, 3))
    return f"| {name} | {len(soon)} | {told[0]} | {told[1]} | {more} | {fewer} | {walk} |"


if __name__ == "__main__":
    main()
