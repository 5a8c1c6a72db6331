"""Futures of SUMO simulations against SUMO itself, from the same moment on and without random driving.

    python -m benchmarks.what_if A.sumocfg B.sumocfg --times 60,120 [--models sumo:own,standard_driver]

Each vehicle's position 3 s later in a future and in the simulation that goes on: number, median, 95 % and
largest distance in m, then the vehicles that have left the simulation but not the future ("phantoms"), and
the future but not the simulation ("lost"). Without files: the simulations of SUMO's own games with cars.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np

from scex_sumo.base.sumo.programs import sumo_home

STEPS = 30
GAMES = ("cross", "square", "ramp", "corridor", "grid6", "fkk_in", "A10KW", "fokr_bs_demo")
OPTIONS = ("--step-length", "0.1", "--no-step-log", "--no-warnings", "--xml-validation", "never")
CHANGES = ("--lanechange.duration", "3")  # as in futures: lane changes take their time


def positions(sumo, names):  # type: ignore[no-untyped-def]
    """Return (x, y) of the centre of each vehicle that is still driving."""
    found = {}
    for name in set(names) & set(sumo.vehicle.getIDList()):
        (x, y), heading = sumo.vehicle.getPosition(name), np.radians(90 - sumo.vehicle.getAngle(name))
        half = sumo.vehicle.getLength(name) / 2
        found[name] = (x - half * np.cos(heading), y - half * np.sin(heading))
    return {name: place for name, place in found.items() if abs(place[0]) < 1e8}


def compare(config: str, time_s: float, model: str) -> None:
    """Print one line of JSON: distances of one simulation's vehicles at one time, phantoms and lost ones."""
    import libsumo as sumo

    import scex_sumo as scex

    warnings.simplefilter("ignore")
    by_sublanes = b"lateral-resolution" in Path(config).read_bytes()
    sumo.start(["sumo", "-c", config, *OPTIONS, *(() if by_sublanes else CHANGES)])
    watch = scex.watch(sumo)
    while sumo.simulation.getTime() < time_s and sumo.simulation.getMinExpectedNumber():
        sumo.simulationStep()
    for name in sumo.vehicle.getIDList():
        sumo.vehicle.setImperfection(name, 0.0)
    run = watch.extrapolate(futures=1, models=model, steps=STEPS, reference="none")
    names = {int(track): name for track, name in watch.scene().source["vehicles"].items()}
    for _ in range(STEPS):
        sumo.simulationStep()
        for name in sumo.simulation.getDepartedIDList():
            sumo.vehicle.setImperfection(name, 0.0)
    there = positions(sumo, names.values())
    last = run.tracks.filter(run.tracks["frame_id"].to_numpy() == run.tracks["frame_id"].to_numpy().max())
    off = {
        names[track]: float(np.hypot(x - there[names[track]][0], y - there[names[track]][1]))
        for track, x, y in zip(*(last[key].to_pylist() for key in ("track_id", "x", "y")), strict=True)
        if x is not None and names[track] in there
    }
    here = {
        names[track]
        for track, x in zip(last["track_id"].to_pylist(), last["x"].to_pylist(), strict=True)
        if x is not None
    }
    print(json.dumps([list(off.values()), len(here - there.keys()), len(there.keys() - here)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("configs", nargs="*", type=Path)
    parser.add_argument("--times", default="60,120")
    parser.add_argument("--models", default="sumo:own,standard_driver")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        config, at, model = given.one
        return compare(config, float(at), model)
    games = sumo_home() / "tools" / "game"
    for config in given.configs or [games / f"{name}.sumocfg" for name in GAMES]:
        for model in given.models.split(","):
            off, phantoms, lost = list[float](), 0, 0
            for at in given.times.split(","):
                one = ["-m", "benchmarks.what_if", "--one", str(config.resolve()), at, model]
                done = subprocess.run([sys.executable, *one], capture_output=True, text=True)
                if done.returncode:
                    print(f"{config.stem} {at} s: {done.stderr.strip().splitlines()[-1]}")
                    continue
                found, more, fewer = json.loads(done.stdout.splitlines()[-1])
                off, phantoms, lost = off + found, phantoms + more, lost + fewer
            if off:
                middle, high = np.quantile(off, [0.5, 0.95])
                numbers = f"{len(off):5} {middle:7.3f} {high:7.2f} {max(off):7.2f} {phantoms:3} {lost:3}"
                print(f"{config.stem:12} {model:16} {numbers}")


if __name__ == "__main__":
    main()
