"""Train the network of `scex_sumo.people.expectation` on the training parts of `people_moments`.

    python benchmarks/train_people.py --data ../shared/data             # cross-validation and weights
    python benchmarks/train_people.py --data ../shared/data --dry       # cross-validation alone

Needs torch. Folds are by clip. Scales are fitted to the deviations in clips that the network has not seen.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from people_moments import FITTED_SETS, STEPS, Moment, moments
from scipy.stats import t as student

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.projection import foot_points
from scex_sumo.people.expectation import WEIGHTS, scale_features, shown
from scex_sumo.people.ways import ways_of
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene, States, VehicleIndex

EVERY_S, NEAR_M = 0.2, 15.0
TAILS = 4.0
VEHICLES, PEOPLE = 8, 14  # others at most, the nearest ones
SHARES = {
    "DUT intersection": 1.0,
    "TAF-BW": 0.25,
}  # of a batch; more would learn the few people of TAF-BW by heart
FOLDS = 3
SHRUNK = 0.7  # towards constant velocity: the best of 1, 0.8, 0.6, 0.4 is between in both sets' folds
WIDENED = 1.25  # scales: in closed loop the training parts then have 88 % along on average, else 85 %
HIDDEN, NOISE_MPS = 0.25, 0.02  # share of moments without vehicles, or people; noise of velocities
SHORT = 0.15  # share of the moments whose past is cut
OWN, OTHER = 23, 11
MIRRORED_OWN = [k for k in range(HISTORY_STEPS, 2 * HISTORY_STEPS)]
MIRRORED_OTHER = [1, 3, 5, 10]
FUTURES = 8  # paths that are tried for the one that was taken


@dataclass(frozen=True, kw_only=True)
class Samples:
    """N people of all moments: inputs, way beyond constant velocity (N, 2), m, and what they are of."""

    own: FloatArray
    vehicles: FloatArray
    people: FloatArray
    way: FloatArray
    data: FloatArray
    clip: FloatArray
    near: BoolArray
    kind: FloatArray

    def take(self, keep: BoolArray) -> Samples:
        return Samples(**{name: values[keep] for name, values in vars(self).items()})


def samples(many: list[Moment], seed: int = 0) -> Samples:
    """Return the samples of moments, some with a shorter past."""
    rng, rows = np.random.default_rng(seed), list[dict[str, object]]()
    for moment in many:
        scene, people = moment.scene, moment.people
        way = ways_beyond(scene, people)
        if short := rng.random() < SHORT:
            scene = shortened(scene, int(rng.integers(1, HISTORY_STEPS)))
            way = ways_beyond(scene, people)
        assert scene.people is not None
        seen, cars = shown(scene), np.flatnonzero(~scene.people)
        for row, k in enumerate(people):
            apart = np.hypot(scene.now.x[cars] - scene.now.x[k], scene.now.y[cars] - scene.now.y[k])
            mine = seen.of == k
            rows.append(
                {
                    "own": seen.own[k],
                    "vehicles": padded(seen.pairs[mine & ~seen.by_person], VEHICLES),
                    "people": padded(seen.pairs[mine & seen.by_person], PEOPLE),
                    "way": way[row],
                    "data": moment.data,
                    "clip": moment.clip,
                    "near": apart.min(initial=np.inf) < NEAR_M and not short,
                    "kind": scene.types[k],
                }
            )
    return Samples(**{name: np.array([row[name] for row in rows]) for name in rows[0]})


def padded(pairs: FloatArray, most: int) -> FloatArray:
    """Return (most, 12) pairs, the nearest first, and whether each is there."""
    pairs = pairs[np.argsort(-pairs[:, 6])[:most]]
    out = np.zeros((most, OTHER + 1))
    out[: len(pairs), :OTHER], out[: len(pairs), OTHER] = pairs, 1.0
    return out


def shortened(scene: SeedScene, known: int) -> SeedScene:
    """Return a scene of which only some last steps are known; constant velocity gives the others."""
    first = HISTORY_STEPS - known
    start = scene.history[:, first]
    back = STEP_S * np.minimum(np.arange(HISTORY_STEPS + 1) - first, 0)
    after = scene.history[:, first + 1]
    speed = np.hypot(after.x - start.x, after.y - start.y) / STEP_S
    heading = np.where(speed > 0, np.arctan2(after.y - start.y, after.x - start.x), start.heading)
    line = replace(start, heading=heading).ahead(speed[:, None] * back, np.repeat(speed[:, None], 11, axis=1))
    past = States.joined([scene.history, line], lambda parts: np.where(back < 0, parts[1], parts[0]))
    return replace(scene, history=past, recorded_steps=np.minimum(scene.recorded_steps, known))


def ways_beyond(scene: SeedScene, people: IntArray) -> FloatArray:
    """Return the ways (P, 2) beyond constant velocity after 3 s; bends of ways are no turns."""
    seen, future = shown(scene), scene.future
    assert future is not None
    now, then = scene.now[people], future[people, STEPS - 1]
    direction = seen.direction[people]
    way = (then.x - now.x + 1j * (then.y - now.y)) * np.exp(-1j * direction)
    for kind in ("pedestrian", "bicycle"):
        mine = np.flatnonzero(np.array([scene.types[k] == kind for k in people]))
        if scene.road is None or not len(mine):
            continue
        draws = np.repeat((np.arange(FUTURES)[:, None] + 0.5) / FUTURES, scene.vehicles, axis=1)
        history = SceneHistory(
            scene=scene,
            states=scene.history.repeat(FUTURES),
            futures=np.arange(FUTURES),
            step=0,
            route_draw=draws,
        )
        future_row, person = np.repeat(np.arange(FUTURES), len(mine)), np.tile(people[mine], FUTURES)
        ways = ways_of(history, scene.road, VehicleIndex(future=future_row, vehicle=person), kind)
        if ways is None:
            continue
        end = States.joined([then[mine]] * FUTURES, np.concatenate)
        s, aside, _ = foot_points(
            ways.paths, ways.row, end.x, end.y, ways.s + 3 * np.tile(seen.speed[people[mine]], FUTURES)
        )
        off = np.abs(aside - ways.aside).reshape(FUTURES, -1)
        best = off.argmin(axis=0) * len(mine) + np.arange(len(mine))
        bent = (s - ways.s)[best] + 1j * (aside - ways.aside)[best]
        bent = bent * np.exp(1j * (ways.begin[best] - direction[mine]))
        way[mine] = np.where(ways.on[best], bent, way[mine])
    way = way - STEPS * STEP_S * seen.speed[people]
    return np.stack([way.real, way.imag], axis=1)


class Network(torch.nn.Module):
    """The network of `expected`, in torch."""

    def __init__(self, hidden: int = 48, wide: int = 48) -> None:
        super().__init__()
        relu = torch.nn.ReLU
        for name in ("vehicles", "people"):
            parts = (torch.nn.Linear(OTHER, hidden), relu(), torch.nn.Linear(hidden, hidden), relu())
            setattr(self, name, torch.nn.Sequential(*parts))
        self.own = torch.nn.Sequential(
            torch.nn.Linear(OWN + 2 * hidden, wide),
            relu(),
            torch.nn.Linear(wide, wide),
            relu(),
            torch.nn.Linear(wide, 2),
        )

    def forward(self, own: torch.Tensor, vehicles: torch.Tensor, people: torch.Tensor) -> torch.Tensor:
        sums = [
            (part(seen[..., :OTHER]) * seen[..., OTHER:]).sum(dim=1)
            for part, seen in ((self.vehicles, vehicles), (self.people, people))  # type: ignore[operator]
        ]
        return self.own(torch.cat([own, *sums], dim=1))


def trained(data: Samples, seed: int, *, steps: int = 2500, batch: int = 128) -> Network:
    """Return a network that was trained for the least mean error."""
    torch.manual_seed(seed)
    rng, network = np.random.default_rng(seed), Network()
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    share = shares(data)
    for _ in range(steps):
        pick = rng.choice(len(share), batch, p=share)
        own, vehicles, people, way = (
            torch.tensor(values[pick], dtype=torch.float32)
            for values in (data.own, data.vehicles, data.people, data.way)
        )
        mirror = torch.tensor(rng.random(batch) < 0.5, dtype=torch.float32)
        sign = 1 - 2 * mirror[:, None]
        own[:, MIRRORED_OWN] *= sign
        for others in (vehicles, people):
            others[..., MIRRORED_OTHER] *= sign[..., None]
            others[..., OTHER] *= torch.tensor(rng.random(batch) > HIDDEN, dtype=torch.float32)[:, None]
        own[:, : 2 * HISTORY_STEPS] += NOISE_MPS * torch.randn(batch, 2 * HISTORY_STEPS)
        way = way * torch.cat([torch.ones_like(sign), sign], dim=1)
        left = way - network(own, vehicles, people)
        loss = torch.sqrt((left**2).sum(dim=1) + 1e-3).mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    return network.eval()


def predicted(network: Network, data: Samples) -> FloatArray:
    """Return (N, 2) outputs."""
    inputs = (torch.tensor(v, dtype=torch.float32) for v in (data.own, data.vehicles, data.people))
    with torch.no_grad():
        return np.asarray(SHRUNK * network(*inputs).numpy(), dtype=np.float64)


def folds(data: Samples) -> list[BoolArray]:
    """Return which samples are validated in each fold: whole clips, of k733 parts of its time."""
    found = []
    for fold in range(FOLDS):
        mine = np.zeros(len(data.way), dtype=bool)
        for name in FITTED_SETS:
            names = np.unique(data.clip[data.data == name])
            mine |= (data.data == name) & np.isin(data.clip, names[fold::FOLDS])
        found.append(mine)
    return found


def scales(data: Samples, left: FloatArray) -> FloatArray:
    """Return weights (2, G) of the logarithm of scales: the likeliest for deviations (N, 2)."""
    seen = torch.tensor(scale_features(data.own))
    share = torch.tensor(shares(data, dict.fromkeys(SHARES, 1.0)))
    found = []
    for values in torch.tensor(left.T):
        weight = torch.zeros(seen.shape[1], dtype=torch.float64, requires_grad=True)
        optimizer = torch.optim.LBFGS([weight], max_iter=200)

        def surprise(values: torch.Tensor = values, weight: torch.Tensor = weight) -> torch.Tensor:
            scale = seen @ weight
            tail = (TAILS + 1) / 2 * torch.log1p((values * torch.exp(-scale)) ** 2 / TAILS)
            return (share * (scale + tail)).sum() + 1e-3 * (weight**2).sum()

        def step(optimizer: torch.optim.Optimizer = optimizer) -> torch.Tensor:
            optimizer.zero_grad()
            loss = surprise()
            loss.backward()  # type: ignore[no-untyped-call]
            return loss

        optimizer.step(step)  # type: ignore[no-untyped-call]
        found.append(weight.detach().numpy())
    return np.array(found)


def shares(data: Samples, given: dict[str, float] = SHARES) -> FloatArray:
    """Return (N,) the share of each sample, by site."""
    share = np.zeros(len(data.way))
    for name, part in given.items():
        mine = data.data == name
        share[mine] = part / max(mine.sum(), 1)
    return share / share.sum()


def measured(name: str, data: Samples, out: FloatArray, weight: FloatArray) -> None:
    """Print error beside constant velocity's, and coverage of intervals of 90 %."""
    most = student.ppf(0.95, TAILS) * np.exp(scale_features(data.own) @ weight.T)
    for kind in np.unique(data.kind):
        mine = data.near & (data.kind == kind)
        if not mine.any():
            continue
        left = data.way[mine] - out[mine]
        error, constant = np.hypot(*left.T).mean(), np.hypot(*data.way[mine].T).mean()
        inside = 100 * (np.abs(left) < most[mine]).mean(axis=0)
        print(
            f"{name} {kind}: {mine.sum()}, {error:.3f} / {constant:.3f} m = {error / constant:.3f}, "
            f"{inside[0]:.0f} % along, {inside[1]:.0f} % across",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--dry", action="store_true")
    options = parser.parse_args()
    torch.set_num_threads(1)
    data = samples(moments(options.data, EVERY_S, "train"))
    print(f"{len(data.way)} people of moments", flush=True)
    out = np.zeros((len(data.way), 2))
    for fold in folds(data):
        out[fold] = predicted(trained(data.take(~fold), 0), data.take(fold))
    weight = scales(data, data.way - out)
    for name in FITTED_SETS:
        mine = data.data == name
        measured(name, data.take(mine), out[mine], weight)
    if not options.dry:
        network = trained(data, 0)
        values = {name: value.numpy().astype(np.float32) for name, value in network.state_dict().items()}
        for name in [name for name in values if name.startswith("own.4")]:
            values[name] *= SHRUNK
        weight[:, 0] += np.log(WIDENED)
        arrays = {**renumbered(values), "scale": weight.astype(np.float32)}
        np.savez_compressed(WEIGHTS, **arrays)  # type: ignore[arg-type]


def renumbered(values: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return layers numbered from 0 on; torch counts the ReLU between them, too."""
    return {f"{n.split('.')[0]}.{int(n.split('.')[1]) // 2}.{n.split('.')[2]}": v for n, v in values.items()}


if __name__ == "__main__":
    main()
