"""How long before SUMO's own collisions the extrapolation sees them, beside the SSM device's measures.

    python -m benchmarks.live collisions OUT [--seeds 1,2,3,4,5,6] [--to 75]

Drivers of a grid without lights follow too closely (tau 0.3 s, action steps of 0.8 s), dawdle (sigma 0.8) and
at times ignore who has the right of way, so they collide (--collision.action warn). Each collision is looked
at 1, 2 and 3 s before, with all pairs within 50 m at that time that do not touch yet: the share of
collisions whose pair is among the top 5 %, and the area under the ROC curve of all pairs.

    xvfb-run -a python -m benchmarks.live film FILM.mp4 [--scenario MINE.sumocfg] [--from 20] [--to 40]

Film of sumo-gui while it is watched, a picture for each step of the simulation, and a picture of the worst
moment beside it; of the grid above if no scenario is named.
"""

from __future__ import annotations

import argparse
import json
import warnings
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import traci
from PIL import Image

from scex_sumo.live.moment import Focus
from scex_sumo.live.risk import Question, Risk, assess
from scex_sumo.live.session import Receiver, Session
from scex_sumo.live.watch import Watch
from tests.formats.sumo.simulations import run as sumo_program

PICTURE = (1040, 534)  # px, of a film: as the view in a window of its first size
LEADS_S, NEAR_M, TOP, QUIET_S = (1.0, 2.0, 3.0), 50.0, 0.05, 5.0
ROUTES = """<routes>
 <vType id="car" length="4.5" minGap="1.0" tau="0.3" sigma="0.8" actionStepLength="0.8" speedDev="0.2"
        jmIgnoreFoeProb="0.15" jmIgnoreFoeSpeed="8" jmIgnoreJunctionFoeProb="0.1" jmTimegapMinor="0.2"
        lcAssertive="2"/>
 {flows}
</routes>"""
CONFIG = """<configuration><input><net-file value="g.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><end value="600"/><step-length value="0.1"/></time></configuration>"""


def write_scenario(folder: Path) -> None:
    """Write a grid of 2 x 2 junctions with roads to all sides and traffic through it."""
    grid = ["--grid", "--grid.number", 2, "--grid.length", 120, "--grid.attach-length", 120, "-L", 1]
    sumo_program("netgenerate", *grid, "-j", "priority", "-o", "g.net.xml", "--seed", 3, cwd=folder)
    edges = [edge.get("id", "") for edge in ElementTree.parse(folder / "g.net.xml").iter("edge")]
    ends = [e for e in edges if not e.startswith(":")]
    into = [e for e in ends if e.startswith(("left", "right", "top", "bottom"))]
    out = [
        e for e in ends if any(word in e[1:] for word in ("left", "right", "top", "bottom")) and e not in into
    ]
    flow = 'begin="0" end="600" probability="0.035" departSpeed="max"'
    flows = [
        f'<flow id="{k}" type="car" {flow} from="{a}" to="{b}"/>'
        for k, (a, b) in enumerate((a, b) for a in into for b in out if a[:3] not in b)
    ]
    (folder / "r.rou.xml").write_text(ROUTES.format(flows="\n ".join(flows)))
    (folder / "mine.sumocfg").write_text(CONFIG)


def start(folder: Path, seed: int, *more: str):  # type: ignore[no-untyped-def]
    import libsumo as sumo

    quiet = ("--no-step-log", "--no-warnings", "--xml-validation", "never", "--time-to-teleport", "60")
    own = ("--collision.action", "warn", "--collision.check-junctions", "--collision.mingap-factor", "0")
    sumo.start(["sumo", "-c", str(folder / "mine.sumocfg"), *quiet, *own, "--seed", str(seed), *more])
    return sumo


def collisions(folder: Path, seed: int, to_s: float) -> dict[frozenset[str], float]:
    """Return the first contact of each pair of which neither vehicle touched another one before."""
    ssm = ("probability", "1"), ("measures", "TTC DRAC PET"), ("thresholds", "1000 0 1000")
    ssm += ("trajectories", "true"), ("range", "50"), ("file", str(folder / f"ssm{seed}.xml"))
    sumo = start(folder, seed, *(word for name, value in ssm for word in (f"--device.ssm.{name}", value)))
    found, touched = dict[frozenset[str], float](), dict[str, float]()
    while sumo.simulation.getTime() < to_s:
        sumo.simulationStep()
        now = sumo.simulation.getTime()
        for one in sumo.simulation.getCollisions():
            pair = frozenset((one.collider, one.victim))
            if not any(now - touched.get(name, -99.0) < QUIET_S for name in pair):
                found.setdefault(pair, now)
            touched |= dict.fromkeys(pair, now)
    sumo.close()
    return found


def numbers_of(conflict: ElementTree.Element, tag: str) -> list[float]:
    span = conflict.find(tag)
    values = [] if span is None else span.get("values", "").split()
    return [float(value.replace("NA", "nan")) for value in values]


def device(file: Path) -> dict[tuple[frozenset[str], float], dict[str, float]]:
    """Return what the SSM device knows of a pair at a time: 1 / TTC, DRAC, 1 / PET so far."""
    known: dict[tuple[frozenset[str], float], dict[str, float]] = {}
    for conflict in ElementTree.parse(file).getroot().iter("conflict"):
        pair, times = (
            frozenset((conflict.get("ego", ""), conflict.get("foe", ""))),
            numbers_of(conflict, "timeSpan"),
        )
        pet = conflict.find("PET")
        at_s, pet_s = (
            (float(pet.get("time")), float(pet.get("value")))
            if pet is not None and pet.get("value", "NA") != "NA"
            else (np.inf, np.inf)
        )
        ttc, drac = numbers_of(conflict, "TTCSpan"), numbers_of(conflict, "DRACSpan")
        for k, time_s in enumerate(times):
            entry = known.setdefault((pair, round(time_s, 1)), {"ttc": 0.0, "drac": 0.0, "pet": 0.0})
            new = {
                "ttc": 1 / max(ttc[k], 1e-3) if k < len(ttc) and np.isfinite(ttc[k]) else 0.0,
                "drac": drac[k] if k < len(drac) and np.isfinite(drac[k]) else 0.0,
                "pet": 1 / max(pet_s, 1e-3) if at_s <= time_s else 0.0,
            }
            entry |= {name: max(entry[name], value) for name, value in new.items()}
    return known


def look(folder: Path, seed: int, hits: dict[frozenset[str], float], futures: int) -> list[dict]:  # type: ignore[type-arg]
    """Return the scores of all pairs at the times before each collision."""
    wanted = sorted({round(at_s - lead, 1) for at_s in hits.values() for lead in LEADS_S if at_s - lead > 3})
    known, rows = device(folder / f"ssm{seed}.xml"), list[dict]()  # type: ignore[type-arg]
    sumo = start(folder, seed)
    watch = Watch(sumo, folder / "g.net.xml")
    for now in wanted:
        while sumo.simulation.getTime() < now - 1e-6:
            sumo.simulationStep()
        focus = Focus(busiest=60)
        risk = assess(watch.moment(focus), Question(futures=futures))
        own = {frozenset(pair.names): pair for pair in risk.pairs}
        place = {name: sumo.vehicle.getPosition(name) for name in risk.vehicles}
        for a, b in combinations(risk.vehicles, 2):
            pair, at_s = frozenset((a, b)), hits.get(frozenset((a, b)))
            if np.hypot(place[a][0] - place[b][0], place[a][1] - place[b][1]) > NEAR_M:
                continue
            if at_s is not None and at_s <= now:
                continue  # they have touched
            mine, theirs = own.get(pair), known.get((pair, round(now, 1)), {})
            after = None if at_s is None else round(at_s - now, 1)
            rows.append(
                {
                    "seed": seed, "time": now, "pair": sorted(pair), "after": after,
                    "human_like": mine.human_like if mine else 0.0,
                    "stress": (mine.stress or 0.0) if mine else 0.0,
                    **{name: theirs.get(name, 0.0) for name in ("ttc", "drac", "pet")},
                }
            )  # fmt: skip
    sumo.close()
    return rows


def area(positive: np.ndarray, negative: np.ndarray) -> float:
    """Return the area under the ROC curve; ties count half."""
    ordered = np.sort(negative)
    below, upto = np.searchsorted(ordered, positive, "left"), np.searchsorted(ordered, positive, "right")
    return float(((below + upto) / 2).mean() / max(len(negative), 1))


def table(rows: list[dict]) -> None:  # type: ignore[type-arg]
    """Print the table of the study."""
    scores = ("human_like", "stress", "both", "ttc", "drac", "pet")
    for row in rows:
        row["both"] = 1 - (1 - row["human_like"]) * (1 - row["stress"])  # PairRisk.combined
    print("s before | collisions | pairs | " + " | ".join(f"{s}: top 5 %, area [of seeds]" for s in scores))
    for lead in LEADS_S:
        moments = {(r["seed"], r["time"]) for r in rows if r["after"] == lead}
        here = [r for r in rows if (r["seed"], r["time"]) in moments]
        hit = np.array([r["after"] == lead for r in here])
        soon = np.array([r["after"] is not None and r["after"] != lead and r["after"] <= 4 for r in here])
        words = []
        for score in scores:
            values = np.array([r[score] for r in here])
            top = []
            for moment in moments:
                mine = np.array([(r["seed"], r["time"]) == moment for r in here])
                for value in values[mine & hit]:
                    rest = values[mine & ~hit]
                    above = (rest > value).sum() + 0.5 * (rest == value).sum()
                    top.append(above < TOP * (len(rest) + 1))
            seeds = np.array([r["seed"] for r in here])
            areas = [
                area(values[mine & hit], values[mine & ~hit & ~soon])
                for mine in (seeds == seed for seed in np.unique(seeds))
            ]
            pooled = area(values[hit], values[~hit & ~soon])
            words.append(f"{np.mean(top):.2f} {pooled:.3f} [{min(areas):.2f}-{max(areas):.2f}]")
        print(f"{lead:g} | {hit.sum()} | {len(here)} | " + " | ".join(words))


def film(path: Path, config: Path | None, begin_s: float, end_s: float) -> None:
    """Write a film of a watched window, and its worst moment as a picture; needs a display and PyAV."""
    risks: list[Risk] = []
    with TemporaryDirectory() as name:
        if config is None:
            write_scenario(Path(name))
        config = config or Path(name, "mine.sumocfg")
        session = Session(
            config=config, out=path.with_suffix(""), gui=True, begin_s=begin_s, end_s=end_s, follow=True,
        )  # fmt: skip

        def begin(watch: Watch, take: Receiver) -> None:
            sumo = watch._sumo

            class Camera(traci.StepListener):  # type: ignore[misc]
                def step(self, t: float = 0.0) -> bool:
                    view = sumo.gui.getIDList()[0]
                    sumo.gui.screenshot(view, f"{name}/{10 * watch.time_s:07.0f}.png")
                    return True

            sumo.addStepListener(Camera())
            watch.every(1.0, take, wait=True, workers=2)

        session.run(begin, risks.append)
        pictures = sorted(Path(name).glob("*.png"))
        write_film(path, pictures, round(len(pictures) / (end_s - begin_s)))
        led = [(risk.worst.combined, risk.time_s) for risk in risks if risk.worst]
        _, time_s = max(led)
        worst = min(pictures, key=lambda file: abs(int(file.stem) / 10 - time_s - 0.3))
        Image.open(worst).convert("RGB").save(path.with_suffix(".png"))


def write_film(path: Path, pictures: list[Path], rate: int) -> None:
    """Encode pictures as H.264."""
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = PICTURE
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "26", "preset": "veryslow"}
        for file in pictures:
            pixels = np.asarray(Image.open(file).convert("RGB").resize(PICTURE))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels)))
        container.mux(stream.encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("collisions", "table", "film"))
    parser.add_argument("path", type=Path)
    parser.add_argument("--seeds", default=None)
    parser.add_argument("--scenario", type=Path)
    parser.add_argument("--from", dest="first", type=float, default=20.0)
    parser.add_argument("--to", type=float, default=75.0)
    parser.add_argument("--futures", type=int, default=64)
    given = parser.parse_args()
    seeds = [*map(int, given.seeds.split(","))] if given.seeds else [*range(1, 7)]
    warnings.simplefilter("ignore")
    if given.what == "film":
        return film(given.path, given.scenario, given.first, given.to)
    given.path.mkdir(parents=True, exist_ok=True)
    if given.what == "collisions":
        write_scenario(given.path)
        for seed in seeds:
            hits = collisions(given.path, seed, given.to)
            print(f"seed {seed}: {len(hits)} collisions", flush=True)
            rows = look(given.path, seed, hits, given.futures)
            (given.path / f"rows{seed}.json").write_text(json.dumps(rows))
    table([row for file in sorted(given.path.glob("rows*.json")) for row in json.loads(file.read_text())])


if __name__ == "__main__":
    main()
