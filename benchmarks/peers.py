"""What others take for the same: highway-env's IDM per vehicle-step, commonroad-crime per metric and pair.

    python benchmarks/peers.py [--folder /tmp/scex-peers]

Each is installed from the package index into a virtual environment of its own, which stays for the next time,
and measured there: processor time of one process after a first round. Beside them, in the same run, what this
project takes: its IDM driver for 64 futures of 11 vehicles on the example roundabout, planned every 0.5 s,
and its metrics for the same.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

VEHICLES, STEPS = 11, 30

# Eleven IDM drivers, lane changes included, on highway-env's own roundabout and on its straight road.
HIGHWAY_ENV = f"""
import time
import gymnasium, highway_env, numpy as np
from highway_env.vehicle.behavior import IDMVehicle
for name in ("highway-v0", "roundabout-v0"):
    env = gymnasium.make(name).unwrapped
    env.reset(seed=0)
    road, rng = env.road, np.random.default_rng(0)
    def begin():
        road.vehicles.clear()
        lanes = [(a, b, i) for a, ends in road.network.graph.items() for b, of in ends.items()
                 for i in range(len(of))]
        while len(road.vehicles) < {VEHICLES}:
            lane = lanes[rng.integers(len(lanes))]
            along = rng.uniform(0, min(road.network.get_lane(lane).length, 300.0))
            road.vehicles.append(IDMVehicle.make_on_lane(road, lane, along, 8.0))
    for _ in range(2):
        spent = steps = 0
        while steps < 20 * {STEPS}:
            begin()
            start = time.process_time()
            for _ in range({STEPS}):
                road.act()
                road.step(0.1)
            spent += time.process_time() - start
            steps += {STEPS}
    print(f"highway-env {{highway_env.__version__ if hasattr(highway_env, '__version__') else ''}} IDM, "
          f"{{name}}: {{1e6 * spent / steps / {VEHICLES}:.0f}} us per vehicle-step")
"""

# A straight road of three lanes, eleven cars at different speeds; every ordered pair at some steps.
CRIME = f"""
import itertools, logging, math, time, warnings
warnings.simplefilter("ignore")
logging.disable(logging.CRITICAL)
import numpy as np
from importlib.metadata import version
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import InitialState, KSState
from commonroad.scenario.trajectory import Trajectory
from commonroad_crime.data_structure.configuration import CriMeConfiguration
from commonroad_crime.measure import THW, TTC, WTTC

x = np.arange(0.0, 800.0, 2.0)
def line(y):
    return np.column_stack([x, np.full_like(x, y)])
lanes = [Lanelet(line(3.5 * k + 3.5), line(3.5 * k + 1.75), line(3.5 * k), k + 1,
                 adjacent_left=k + 2 if k < 2 else None, adjacent_left_same_direction=True if k < 2 else None,
                 adjacent_right=k if k > 0 else None, adjacent_right_same_direction=True if k > 0 else None)
         for k in range(3)]
scenario = Scenario(0.1, ScenarioID.from_benchmark_id("ZAM_Straight-1_1_T-1", "2020a"))
scenario.add_objects(LaneletNetwork.create_from_lanelet_list(lanes))
for v in range({VEHICLES}):
    y, speed, shape = 3.5 * (v % 3) + 1.75, 8.0 + (7 * v) % 6, Rectangle(4.5, 1.8)
    at = [np.array([100.0 + 14.0 * (v // 3) + 0.1 * speed * t, y]) for t in range({STEPS} + 2)]
    first = InitialState(time_step=0, position=at[0], orientation=0.0, velocity=speed, acceleration=0.0,
                         yaw_rate=0.0, slip_angle=0.0)
    rest = [KSState(time_step=t, position=at[t], orientation=0.0, velocity=speed, steering_angle=0.0)
            for t in range(1, {STEPS} + 2)]
    lanelet = {{t: {{v % 3 + 1}} for t in range({STEPS} + 2)}}
    plan = TrajectoryPrediction(Trajectory(1, rest), shape, lanelet, lanelet)
    scenario.add_objects(DynamicObstacle(100 + v, ObstacleType.CAR, shape, first, plan, {{v % 3 + 1}}))
pairs = [p for p in itertools.permutations(range(100, 100 + {VEHICLES}), 2)]
for measure in (TTC, WTTC, THW):
    spent = count = failed = 0
    for ego in range(100, 100 + {VEHICLES}, 3):
        config = CriMeConfiguration()
        config.vehicle.ego_id = ego
        config.update(sce=scenario)
        metric = measure(config)
        for other in (b for a, b in pairs if a == ego):
            for step in range(1, {STEPS}, 10):
                start = time.process_time()
                try:
                    metric.compute(other, step, verbose=False)
                except Exception as error:
                    failed, last = failed + 1, error
                spent += time.process_time() - start
                count += 1
    note = f" ({{failed}} of {{count}} failed: {{type(last).__name__}}: {{last}})" if failed else ""
    print(f"commonroad-crime {{version('commonroad-crime')}} {{measure.__name__}}: "
          f"{{1e6 * spent / count:.0f}} us per ordered pair and step{{note}}")
"""


def environment(folder: Path, package: str) -> Path:
    """The interpreter of a virtual environment with a package; made where it is not there."""
    python = folder / package / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder / package)], check=True)
        command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    return python


def ours() -> None:
    """The same quantities here."""
    import numpy as np
    from one_seed import rooms

    import scex_sumo
    from scex_sumo.extrapolation.settings import RunSettings

    columns = RunSettings().columns
    seed = scex_sumo.synthetic_seed(scex_sumo.example_path("roundabout"), vehicles=VEHICLES)
    with tempfile.TemporaryDirectory() as folder:

        def run() -> None:
            out = Path(folder) / "out"
            scex_sumo.extrapolate(
                seed,
                models=["standard_driver"],
                futures=64,
                reference=None,
                report=False,
                out=out,
                overwrite=True,
            )

        run()  # imports
        spent = rooms(run)
    loop = spent["extrapolation"] + spent["behaviors"]
    metrics = spent["metrics"] + spent["evaluation"]
    count = 64 * VEHICLES * STEPS
    print(f"scex-sumo IDM, plans of 3 s every 0.5 s: {1e6 * loop / count:.1f} us per vehicle-step")
    each = 1e6 * metrics / (count * (VEHICLES - 1)) / (len(columns) / 2)
    print(f"scex-sumo metrics, mean of {len(columns) // 2}: {each:.3f} us per ordered pair and step")
    assert np.isfinite(each)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "scex-peers")
    options = parser.parse_args()
    for package, script in (("highway-env", HIGHWAY_ENV), ("commonroad-crime", CRIME)):
        begin = time.perf_counter()
        try:
            python = environment(options.folder, package)
        except subprocess.CalledProcessError as error:
            print(f"{package}: does not install here ({error})")
            continue
        done = subprocess.run([str(python), "-c", script], capture_output=True, text=True, check=False)
        print(done.stdout.strip() or f"{package}: {done.stderr.strip().splitlines()[-1]}")
        print(f"  ({time.perf_counter() - begin:.0f} s)", file=sys.stderr)
    ours()


if __name__ == "__main__":
    main()
