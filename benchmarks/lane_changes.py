"""Lane changes in recordings: how often drivers begin one, how long it takes, and the gaps that they take.

    python benchmarks/lane_changes.py [--data FOLDER] [--part train] [--sites mona,...] [--most 60]

A change is a step from a lane to one beside it, with at least 2 m across both in 4 s.
Exposure is time at more than 3 m/s on a lane with another one beside it, per side. Columns:

- hours: exposure; free: share of it in which the lane beside is free by `lanes_occupied` (headway 0.3 s);
- changes; rate: an hour of exposure; of free: an hour of free exposure;
- lasts: median time that a quintic with the speed at the border needs, s;
- lead, lag: 5 % and 50 % quantile of the headways to the next vehicle ahead and behind on the new lane, s.
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from recorded_scenes import EVERY_S, INTERACTION_SITES, SETS, recorded_parts

from scex_sumo.geometry.polylines import along, length_of, nearest
from scex_sumo.geometry.rectangles import seen_from
from scex_sumo.humans.lines.lanes import lanes_occupied
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.roads.routes import centreline
from scex_sumo.scene import STEP_S, SeedScene

STEPS, STAYS, EVERY, BEFORE = 80, 10, 5, 20  # of futures, on a lane; of exposure; from begin to border
HALF, MOVED_M = 20, 2.0  # of a change: steps, least way across
PEAK = 1.875  # largest over mean speed of a quintic
AROUND_M, FAR_M = 80.0, 100.0
SIDE_M = 1.5, 6.0  # across, to a vehicle on the lane beside


def lanes_of(scene: SeedScene, road: Road, v: int, steps: int) -> np.ndarray:
    """Return the (T,) lanes of a vehicle after each step, -1 off them; short visits do not count."""
    track = scene.future[v, :steps]
    found = match(road, track.x, track.y, track.heading)
    lane = np.full(steps, -1)
    lane[found.vehicle[found.best]] = found.lane_id[found.best]
    return lane


def beside(road: Road, lane: int) -> tuple[int | None, int | None]:
    """Return the lanes on the left and right to which a change is allowed."""
    return (road.lanes[lane].left, road.lanes[lane].right) if lane >= 0 else (None, None)


def at_step(scene: SeedScene, t: int) -> tuple[SeedScene, np.ndarray]:
    """Return the scene as it is some steps later, and which vehicles are there."""
    there = scene.future_valid[:, t]
    index = np.flatnonzero(there)
    later = scene.future[:, t : t + 1]
    return replace(scene.reordered(index, name=scene.name), history=later[index]), index


def measure(scene: SeedScene, into: dict[str, list]) -> None:
    """Add exposure and changes of a moment's recorded future."""
    road, human = scene.road, human_parameters()
    steps = min(STEPS, scene.future.x.shape[1])
    occupied = {}
    for t in range(0, steps, EVERY):
        later, index = at_step(scene, t)
        if len(index):
            occupied[t] = dict(
                zip(index.tolist(), lanes_occupied(later, human, human.occupied_headway_s), strict=True)
            )
    for v in range(scene.vehicles):
        known = int(np.argmin(np.append(scene.future_valid[v, :steps], False)))
        if known < 2 * STAYS:
            continue
        lane = lanes_of(scene, road, v, known)
        for t in range(0, known, EVERY):
            if scene.future.speed[v, t] < human.change_speed_mps:
                continue
            for side, other in enumerate(beside(road, int(lane[t]))):
                if other is not None:
                    into["exposure"].append(EVERY * STEP_S / 3600)
                    into["free"].append(not occupied[t][v][side])
        for t in range(STAYS, known - STAYS):
            side = next((k for k, i in enumerate(beside(road, int(lane[t - 1]))) if i == lane[t]), None)
            if side is None or lane[t] < 0 or scene.future.speed[v, t] < human.change_speed_mps:
                continue
            if len({*lane[t - STAYS : t]}) > 2 or lane[t - 1] in lane[t : t + STAYS]:
                continue
            add_change(scene, v, t, (int(lane[t - 1]), int(lane[t]), side), into)


def across(road: Road, lane: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return signed distances (T,) from the line of a lane, extended on both sides, m, left positive."""
    line, _ = centreline(road, (lane,), 0.0, AROUND_M, AROUND_M + length_of(road.lanes[lane].centreline))
    s = np.array([nearest(line, *point) for point in zip(x, y, strict=True)])
    here, there = along(line, s), along(line, s + 1.0)
    dx, dy = (there - here).T
    return dx * (y - here[:, 1]) - dy * (x - here[:, 0])


def add_change(scene: SeedScene, v: int, t: int, lanes: tuple[int, int, int], into: dict[str, list]) -> None:
    """Add a change from a lane to another one on a side if the vehicle moves across both."""
    span = slice(max(t - HALF, 0), t + HALF)
    x, y, sign = scene.future.x[v, span], scene.future.y[v, span], 1.0 - 2 * lanes[2]
    lines = [sign * across(scene.road, lane, x, y) for lane in lanes[:2]]
    if min(line[-1] - line[0] for line in lines) < MOVED_M:
        return
    into["changes"].append(lanes[2])
    k = min(t, HALF)
    speed = (lines[1][k + 3] - lines[1][k - 3]) / (6 * STEP_S)
    into["lasts"].append(PEAK * human_parameters().lane_width_m / max(speed, 0.1))
    begin = max(t - BEFORE, 0)
    now, there = scene.future[:, begin], scene.future_valid[:, begin]
    ahead, left, *_ = seen_from(now[v], now).T
    on = there & (sign * left > SIDE_M[0]) & (sign * left < SIDE_M[1])
    apart = np.abs(ahead) - (scene.length[v] + scene.length) / 2
    into["lead"].append(apart[on & (ahead > 0)].min(initial=FAR_M) / now.speed[v])
    behind = np.where(on & (ahead <= 0), apart, FAR_M)
    into["lag"].append(behind.min() / max(float(now.speed[behind.argmin()]), 1.0))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--part", default="train", choices=("train", "validation", "test"))
    parser.add_argument("--sites", default=",".join((*SETS, "ngsim", *INTERACTION_SITES)))
    parser.add_argument("--most", type=int, default=1000, help="moments of each site")
    arguments = parser.parse_args()
    rows: dict[str, dict[str, list]] = {}
    for site in arguments.sites.split(","):
        EVERY_S[site] = max(EVERY_S[site], STEPS * STEP_S)
        for count, scene in enumerate(recorded_parts(arguments.data, site, arguments.part)):
            if count < arguments.most:
                measure(scene, rows.setdefault(f"{site} {scene.location}"[:40], defaultdict(list)))
    columns = ["hours", "free", "changes", "rate", "of free", "lasts", "lead 5", "lead 50", "lag 5", "lag 50"]
    print(f"{'site':40}" + "".join(f"{name:>9}" for name in columns))
    for site, of in rows.items():
        hours, free, count = sum(of["exposure"]), float(np.mean(of["free"] or [np.nan])), len(of["changes"])
        gaps = [np.quantile(of[k] or [np.nan], q) for k in ("lead", "lag") for q in (0.05, 0.5)]
        cells = (hours, free, count, count / max(hours, 1e-9), count / max(hours * free, 1e-9),
                 float(np.median(of["lasts"] or [np.nan])), *gaps)  # fmt: skip
        print(f"{site:40}" + "".join(f"{x:9.2f}" for x in cells))


if __name__ == "__main__":
    main()
