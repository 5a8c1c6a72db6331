"""Fit the people of `scex_sumo.people` to recordings, and tell how valid they are beside constant velocity.

    python benchmarks/fit_people.py --data ../shared/data          # validity of the shipped parameters
    python benchmarks/fit_people.py --data ../shared/data --fit    # fit, and write parameters.json

Vehicles are replayed, people are simulated in closed loop for 3 s from every second of a recording, 40 times.
Parts for fit and table: see `people_moments`. `train_people` trains the network of expected motion.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from people_moments import STEPS, Moment, moments

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.rectangles import Rectangles, overlap_area
from scex_sumo.people.models import Person, PersonProfile
from scex_sumo.people.parameters import SHIPPED, PeopleParameters, people_parameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, States, VehicleIndex

REPLAN, NEAR_M = 5, 15.0
FITTED = {
    "sway_mps": (0.5, 2.0),
    "stop_share": (0.1, 0.3, 3.0),
    "start_share": (0.3, 0.6, 1.6),
    "gap_s": (0.0, 0.5, 1.5),
    "gap_spread_s": (0.5, 2.0),
}
"""Factors by which each parameter is varied in turn."""

EMPTY = Road(name="none", lanes={})


def simulate(moment: Moment, models: dict[str, Person], futures: int) -> States:
    """Return the simulated states (C, P, T) of the people; vehicles are replayed."""
    scene, people = moment.scene, moment.people
    assert scene.future is not None
    window = scene.history.repeat(futures)
    draws = np.random.default_rng(0).random((futures, scene.vehicles))
    kinds = np.array([scene.types[k] for k in people])
    out = States.empty((futures, len(people), STEPS))
    road = scene.road or EMPTY
    for step in range(0, STEPS, REPLAN):
        history = SceneHistory(
            scene=scene, states=window, futures=np.arange(futures), step=step, route_draw=draws
        )
        coming = scene.future[:, step : step + REPLAN].repeat(futures)
        for kind, model in models.items():
            mine = people[kinds == kind]
            if not len(mine):
                continue
            future, vehicle = (v.ravel() for v in np.meshgrid(np.arange(futures), mine, indexing="ij"))
            plan = model.plan(history, road, VehicleIndex(future=future, vehicle=vehicle), [])
            coming.assign((future, vehicle), plan[:, :REPLAN])
        out.assign((slice(None), slice(None), slice(step, step + REPLAN)), coming[:, people])
        window = States.concatenate([window[:, :, REPLAN:], coming], axis=2)
    return out


def models_of(parameters: dict[str, PeopleParameters]) -> dict[str, Person]:
    """Return a model for each kind of people."""
    return {kind: Person(PersonProfile(), own) for kind, own in parameters.items()}


def energy(
    many: list[Moment], parameters: dict[str, PeopleParameters], kind: str, futures: int = 16
) -> float:
    """Return the mean energy score of positions after 1, 2 and 3 s, m; lower is better."""
    models, scores = models_of(parameters), []
    for moment in many:
        made, scene = simulate(moment, models, futures), moment.scene
        assert scene.future is not None
        for t in (9, 19, 29):
            p = made.x[:, :, t] + 1j * made.y[:, :, t]
            truth = scene.future.x[moment.people, t] + 1j * scene.future.y[moment.people, t]
            spread = np.abs(p[:, None] - p[None]).sum(axis=(0, 1)) / (futures * (futures - 1))
            own = np.array(scene.types)[moment.people] == kind
            scores += (np.abs(p - truth).mean(axis=0) - spread / 2)[own].tolist()
    return float(np.mean(scores))


def fit(data: Path, rounds: int) -> dict[str, PeopleParameters]:
    """Vary one parameter after the other for a lower energy score."""
    parameters = {kind: people_parameters(kind) for kind in ("pedestrian", "bicycle")}
    train = moments(data, 3.0, "train")
    for kind in parameters:
        mine = [m for m in train if kind in np.array(m.scene.types)[m.people]]
        best = energy(mine, parameters, kind)
        for number in range(rounds):
            for name, factors in FITTED.items():
                start = getattr(parameters[kind], name)
                for factor in factors:
                    tried = parameters | {kind: replace(parameters[kind], **{name: round(start * factor, 4)})}
                    if (score := energy(mine, tried, kind)) < best - 1e-4:
                        best, parameters = score, tried
                print(f"{kind} {number} {name} {getattr(parameters[kind], name)}: {best:.4f} m", flush=True)
    return parameters


def table(data: Path, parameters: dict[str, PeopleParameters], futures: int = 40) -> None:
    """Print the validity by data set."""
    models, rows = models_of(parameters), dict[str, list[dict[str, FloatArray]]]()
    for moment in moments(data, 1.0, "test"):
        rows.setdefault(moment.data, []).append(measured(moment, simulate(moment, models, futures)))
    print(
        "data set | people near | error / constant velocity (of the last step) | along | across | "
        "first | P(contact)"
    )
    for name, parts in rows.items():
        one = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        near, first = one["near"] > 0, one["first"]
        error, constant, last = (one[key][near].mean() for key in ("error", "constant", "last"))
        right = [f"{100 * v.mean():.0f} %" if len(v) else "-" for v in (first, one["first_constant"])]
        print(
            f"{name} | {int(near.sum())} | {error:.2f} / {constant:.2f} m = {error / constant:.2f} "
            f"({error / last:.2f}) | "
            f"{100 * one['along'].mean():.0f} % | {100 * one['across'].mean():.0f} % | "
            f"{right[0]} of {len(first)} ({right[1]}) | "
            f"{100 * one['contact'].mean():.2f} % ({100 * one['contact_constant'].mean():.2f} %)"
        )


def measured(moment: Moment, made: States) -> dict[str, FloatArray]:
    """Return errors, coverage, orders and contacts of a moment."""
    scene, people = moment.scene, moment.people
    assert scene.future is not None
    now, truth = scene.now[people], scene.future[people, :STEPS]
    cars = np.flatnonzero(~scene.people) if scene.people is not None else np.arange(0)
    steps = 5
    past = scene.history[people]
    vx, vy = ((v[:, -1] - v[:, -1 - steps]) / (steps * STEP_S) for v in (past.x, past.y))
    time = STEP_S * np.arange(1, STEPS + 1)
    constant = States(
        x=now.x[:, None] + vx[:, None] * time,
        y=now.y[:, None] + vy[:, None] * time,
        heading=np.repeat(np.arctan2(vy, vx)[:, None], STEPS, axis=1),
        speed=np.repeat(np.hypot(vx, vy)[:, None], STEPS, axis=1),
    )
    apart = np.hypot(now.x[:, None] - scene.now.x[cars], now.y[:, None] - scene.now.y[cars])
    error = [
        np.hypot(p.x[..., -1] - truth.x[:, -1], p.y[..., -1] - truth.y[:, -1])
        for p in (made.map(lambda v: np.median(v, axis=0)), constant)
    ]
    way = 3.0 * now.speed * np.exp(1j * now.heading)
    last = np.abs(now.x + 1j * now.y + way - truth.x[:, -1] - 1j * truth.y[:, -1])
    turn = np.exp(-1j * constant.heading[:, -1])
    drawn = (made.x[..., -1] + 1j * made.y[..., -1]) * turn
    real = (truth.x[:, -1] + 1j * truth.y[:, -1]) * turn
    covered = [
        (a >= np.quantile(b, 0.05, axis=0)) & (a <= np.quantile(b, 0.95, axis=0))
        for a, b in ((real.real, drawn.real), (real.imag, drawn.imag))
    ]
    driven = scene.future[cars, :STEPS]
    order = first_of(truth[None], driven)[0]
    met = np.isfinite(order)
    share = np.nanmean(np.where(np.isfinite(o := first_of(made, driven)), o, 0.0), axis=0)
    alone = np.nan_to_num(first_of(constant[None], driven)[0])
    real_hit = touching(truth[None], driven, scene, people, cars)[0]
    counts = (apart <= NEAR_M) & ~real_hit
    hits = touching(made, driven, scene, people, cars).mean(axis=0)
    hits_constant = touching(constant[None], driven, scene, people, cars)[0]
    return {
        "near": (apart.min(axis=1, initial=np.inf) <= NEAR_M).astype(float),
        "error": error[0],
        "constant": error[1],
        "last": last,
        "along": covered[0].astype(float),
        "across": covered[1].astype(float),
        "first": ((share[met] > 0.5) == order[met]).astype(float),
        "first_constant": ((alone[met] > 0.5) == order[met]).astype(float),
        "contact": hits[counts],
        "contact_constant": hits_constant[counts].astype(float),
    }


def first_of(people: States, cars: States) -> FloatArray:
    """Return 1 where a person (C, P) passes first where its way and that of a car (J) cross; NaN: nowhere."""
    p = (people.x + 1j * people.y)[:, :, None, ::3, None]
    q = (cars.x + 1j * cars.y)[None, None, :, None, ::3]
    a, b, c, d = p[..., :-1, :], p[..., 1:, :], q[..., :-1], q[..., 1:]

    def side(o: FloatArray, e: FloatArray, f: FloatArray) -> BoolArray:
        return ((e - o).conj() * (f - o)).imag > 0

    crosses = (side(a, b, c) != side(a, b, d)) & (side(c, d, a) != side(c, d, b))
    found = crosses.reshape(*crosses.shape[:3], -1)
    at = found.argmax(axis=-1)
    mine, theirs = np.divmod(at, crosses.shape[-1])
    return np.where(found.any(axis=-1), (mine < theirs).astype(float), np.nan)


def touching(people: States, cars: States, scene: SeedScene, who: IntArray, of: IntArray) -> BoolArray:
    """Return whether boxes (C, P, J) overlap by more than 0.02 m² at some time."""
    one = people.map(lambda v: v[:, :, None, ::2])
    two = cars.map(lambda v: v[None, None, :, ::2])
    near = np.hypot(one.x - two.x, one.y - two.y) < 3.5
    c, p, j, t = np.nonzero(near)
    boxes = (
        Rectangles.of(one[c, p, 0, t], scene.length[who[p]], scene.width[who[p]]),
        Rectangles.of(two[0, 0, j, t], scene.length[of[j]], scene.width[of[j]]),
    )
    hit = overlap_area(*boxes) > 0.02
    result = np.zeros(near.shape[:3], dtype=np.bool_)
    result[c[hit], p[hit], j[hit]] = True
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    parameters = {kind: people_parameters(kind) for kind in ("pedestrian", "bicycle")}
    if options.fit:
        parameters = fit(options.data, options.rounds)
        values = json.loads(SHIPPED.read_text(encoding="utf-8"))
        for kind, own in parameters.items():
            values[kind] = {name: getattr(own, name) for name in values[kind]}
        SHIPPED.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    table(options.data, parameters)


if __name__ == "__main__":
    main()
