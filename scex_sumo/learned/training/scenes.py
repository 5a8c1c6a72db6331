"""Fit of the scene model: places and motions of a recorded scene's vehicles, given some of the others."""

from __future__ import annotations

import copy
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import torch
from torch import Tensor, nn

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.split import Part, Split
from scex_sumo.generators.scene_context import (
    COLUMNS,
    LaneCells,
    Placed,
    demands,
    lane_cells,
    needed_deceleration,
    place_features,
    placed_on_lanes,
)
from scex_sumo.generators.scene_model import DRAWN, KINDS, MOTION, SceneModel, pace_terms, usual_pace
from scex_sumo.learned.training.data.dataset import loaded_sites, part_scenes
from scex_sumo.scene import SeedScene

ATOM = 0.03  # a value of a quantity with a larger share has a bin of its own
SHARES = np.array([0.0005, 0.005, 0.02, *np.linspace(0.05, 0.95, 19), 0.98, 0.995, 0.9995])  # between bins
HIDDEN = 64
SUBSETS, TARGETS, ELSEWHERE = 2, 4, 40  # drawn of each scene; vehicles to place, and other places
COMPLETE, FIRST = 0.3, 0.35  # shares of subsets that lack one vehicle, as in a sweep, and that hold few
KEPT = 500  # scenes whose mean speeds the model keeps
MARGIN_M = 5.0  # around what a recording sees
BATCH, EPOCHS, PATIENCE = 128, 12, 4
WIDTHS = np.linspace(0.0, 1.0, 9)
RIDGE = 0.3  # of the slopes of `usual_pace`, because sites are few
USUAL = 0.995  # share of recorded vehicles within each bound of generated ones
MOST_LATERAL_MPS2 = 4.5  # at a lane's curvature; recorded vehicles cut sharp bends and seem to exceed it


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneSamples(Rows):
    """Vehicles to place, (n,) each; the first of the places (n, 1 + `ELSEWHERE`, F) is right."""

    places: FloatArray
    values: FloatArray  # (n, 5) `DRAWN`; NaN where unknown
    width: FloatArray
    kind: IntArray
    site: IntArray


def seen_part(scenes: Sequence[SeedScene]) -> shapely.Geometry:
    """Return the region that recordings of one map see: around the vehicles that were on lanes."""
    points = [np.column_stack([s.now.x, s.now.y]) for s in scenes]
    return shapely.MultiPoint(np.vstack(points)).convex_hull.buffer(MARGIN_M)


def seen_cells(scenes: Sequence[SeedScene]) -> IntArray:
    """Return the cells of the map that recordings see."""
    assert scenes[0].road is not None
    x, y, _ = lane_cells(scenes[0].road).cell_pose
    return np.flatnonzero(shapely.contains_xy(seen_part(scenes), x, y))


def scene_samples(
    scenes: Sequence[SeedScene], inside: IntArray, site: int, rng: np.random.Generator
) -> SceneSamples | None:
    """Return samples of scenes on one map, whose cells ``inside`` are seen."""
    assert scenes[0].road is not None
    table = lane_cells(scenes[0].road)
    total_m = float(table.cell_m[inside].sum())
    samples: list[SceneSamples] = []
    for scene in scenes:
        for _ in range(SUBSETS):
            placed, _ = placed_on_lanes(scene, KINDS, rng)
            if len(placed.lane):
                samples.append(_subset(table, placed, inside, total_m, site, rng))
    return SceneSamples.join(samples) if samples else None


def _subset(
    table: LaneCells, placed: Placed, inside: IntArray, total_m: float, site: int, rng: np.random.Generator
) -> SceneSamples:
    count = len(placed.lane)
    kind, share = rng.random(), rng.random()
    few = count**share - 1 if kind < COMPLETE + FIRST else share * count
    kept = count - 1 if kind < COMPLETE else int(few)
    order = rng.permutation(count)
    others, targets = placed.take(order[:kept]), placed.take(order[kept : kept + TARGETS])
    n = len(targets.lane)
    cells = inside[rng.choice(len(inside), n * ELSEWHERE, p=table.cell_m[inside] / total_m)]
    s = table.cell_s[cells] + table.cell_m[cells] * (rng.random(len(cells)) - 0.5)
    lane, s = np.append(targets.lane, table.cell_lane[cells]), np.append(targets.s, s)
    features = place_features(table, lane, s, others, vehicles=count, total_m=total_m, pace=placed.pace)
    features = features.astype(np.float32)
    places = np.concatenate([features[:n, None], features[n:].reshape(n, ELSEWHERE, -1)], axis=1)
    ratio = np.where(targets.speed < 0.1, 0.0, targets.speed / placed.pace)
    return SceneSamples(
        places=places,
        values=np.column_stack([targets.length, ratio, targets.acceleration, targets.offset, targets.turn]),
        width=targets.width,
        kind=targets.kind,
        site=np.full(n, site),
    )


def known_scenes(table: LaneCells, inside: IntArray, wholes: Sequence[Placed]) -> FloatArray:
    """Return (S, 3 + R) ``scenes`` of a `SceneModel` on one map.

    Args:
        inside: cells that the recording sees.
        wholes: (S,) vehicles on lanes; scenes without any are left out.
    """
    total_m = table.cell_m[inside].sum()
    road = table.cell_m[inside] @ table.fixed[inside] / total_m
    pairs = [(len(w.lane), w.pace) for w in wholes if len(w.lane)]
    count, pace = np.array(pairs).reshape(-1, 2).T
    fixed = np.tile(np.append(road, total_m), (len(count), 1))
    return np.column_stack([np.log(1000 * count / total_m), np.log(pace), fixed])


def pace_slopes(known: Sequence[FloatArray]) -> FloatArray:
    """Return the slopes (2,) of `usual_pace` by ridge regression; all sites have the same weight.

    ``known``: (S, 3 + R) of `known_scenes` for each site.
    """
    scenes = np.concatenate(known)
    weight = np.concatenate([np.full(len(k), 1.0 / max(len(k), 1)) for k in known])
    ratio = scenes[:, 1] - usual_pace(scenes, np.zeros(2))
    x = pace_terms(scenes)
    x, y = (v - np.average(v, axis=0, weights=weight) for v in (x, ratio))
    square = x.T @ (weight[:, None] * x)
    penalty = np.diag(RIDGE * np.diag(square) / len(known) + 1e-9)
    return np.asarray(np.linalg.solve(square + penalty, x.T @ (weight * y)))


def bins_of(values: FloatArray) -> FloatArray:
    """Return (K, 2) lowest and highest values of bins; a frequent value has one of its own."""
    values = values[np.isfinite(values)]
    distinct, count = np.unique(values.round(3), return_counts=True)
    atoms = distinct[count > ATOM * len(values)]
    rest = values[~np.isin(values.round(3), atoms)]
    edges = np.unique(np.quantile(rest, SHARES)) if len(rest) > len(SHARES) else np.empty(0)
    spans = np.column_stack([edges[:-1], edges[1:]]) if len(edges) > 1 else np.empty((0, 2))
    return np.vstack([np.column_stack([atoms, atoms]), spans])


def bin_numbers(values: FloatArray, bins: FloatArray) -> IntArray:
    """Return the bin of each value (n,); -1 for NaN."""
    span = bins[:, 1] > bins[:, 0]
    first = int((~span).sum())
    number = first + np.clip(np.searchsorted(bins[span, 1], values), 0, max(int(span.sum()) - 1, 0))
    if first:
        nearest = np.abs(values[:, None] - bins[None, :first, 0]).argmin(axis=1)
        exact = np.abs(values - bins[nearest, 0]) < 6e-4
        number = np.where(exact | (not span.any()), nearest, number)
    return np.where(np.isnan(values), -1, number)


def fit(
    train: SceneSamples,
    validation: SceneSamples,
    known: Sequence[FloatArray],
    *,
    seed: int = 0,
    epochs: int = EPOCHS,
) -> tuple[dict[str, FloatArray], float]:
    """Fit the networks; return tensors of a `SceneModel` and the validation loss.

    ``known``: (S, 3 + R) of `known_scenes` for each site.
    """
    tensors = _statistics(train, known)
    torch.manual_seed(seed)
    state, loss = _trained(SceneModel(tensors=tensors, meta={}), train, validation, epochs)
    for key, value in state.items():  # place.3.weight is the second layer
        name, layer, kind = key.split(".")
        tensors[f"{name}.{int(layer) // 3}.{kind}"] = value.numpy()
    return tensors, loss


def _statistics(train: SceneSamples, known: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """Return the tensors of a `SceneModel` other than those of its networks."""
    places = train.places[:, ::8].reshape(-1, train.places.shape[2])
    tensors: dict[str, FloatArray] = {"mean": places.mean(axis=0), "spread": places.std(axis=0) + 1e-3}
    scenes = np.concatenate(known)
    tensors["density"] = np.quantile(np.exp(scenes[:, 0]), np.linspace(0, 1, 33))
    tensors["scenes"] = scenes[:: max(len(scenes) // KEPT, 1)]
    tensors["slopes"] = pace_slopes(known)
    for k, name in enumerate(DRAWN):
        tensors[f"bins.{name}"] = bins_of(train.values[:, k])
    by_length = bin_numbers(train.values[:, 0], tensors["bins.length"])
    for name in ("width", "kind"):
        tensors[name] = np.stack(
            [_given_length(train, name, by_length == k) for k in range(by_length.max() + 1)]
        )
    return tensors


def _trained(
    model: SceneModel, train: SceneSamples, validation: SceneSamples, epochs: int
) -> tuple[dict[str, Tensor], float]:
    """Train the networks; return their best state and its validation loss."""
    nets = nn.ModuleDict({"place": _net(len(COLUMNS), 1)})
    for k, name in enumerate(DRAWN):
        nets[name] = _net(len(MOTION) + k, len(model.tensors[f"bins.{name}"]))
    share = np.bincount(train.site)[train.site] ** -0.5
    weight = torch.as_tensor(share / share.mean(), dtype=torch.float32)
    to_fit, to_validate = _tensors(model, train), _tensors(model, validation)
    optimizer = torch.optim.AdamW(nets.parameters(), lr=2e-3, weight_decay=0.02)
    steps = epochs * (len(weight) // BATCH + 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 4e-3, total_steps=steps + 1)
    best, best_epoch, state = np.inf, 0, copy.deepcopy(nets.state_dict())
    for epoch in range(1, epochs + 1):
        nets.train()
        total = 0.0
        for rows in torch.split(torch.randperm(len(weight)), BATCH):
            loss = (_losses(nets, [t[rows] for t in to_fit]) * weight[rows, None]).sum(1).mean()
            optimizer.zero_grad()
            torch.autograd.backward([loss])
            optimizer.step()
            schedule.step()
            total += loss.item() * len(rows)
        nets.eval()
        with torch.no_grad():
            batches = zip(*(torch.split(t, 1024) for t in to_validate), strict=True)
            losses = torch.cat([_losses(nets, [*batch]) for batch in batches])
        score = float(losses.sum(1).mean())
        print(f"epoch {epoch} loss {total / len(weight):.3f} validation {score:.3f}", file=sys.stderr)
        if score < best:
            best, best_epoch, state = score, epoch, copy.deepcopy(nets.state_dict())
        if epoch - best_epoch >= PATIENCE:
            break
    return state, best


def _given_length(samples: SceneSamples, name: str, in_bin: BoolArray) -> FloatArray:
    in_bin = in_bin if in_bin.any() else ~in_bin  # a bin of few samples' lengths may hold none
    if name == "width":
        return np.asarray(np.quantile(samples.width[in_bin], WIDTHS))
    return np.asarray(np.bincount(samples.kind[in_bin], minlength=len(KINDS)) / in_bin.sum())


def _net(inputs: int, outputs: int) -> nn.Sequential:
    layers = [nn.Linear(inputs, HIDDEN), nn.ReLU(), nn.Dropout(0.1), nn.Linear(HIDDEN, HIDDEN), nn.ReLU()]
    return nn.Sequential(*layers, nn.Dropout(0.1), nn.Linear(HIDDEN, outputs))


def _tensors(model: SceneModel, samples: SceneSamples) -> list[Tensor]:
    n, places, width = samples.places.shape
    scaled = model.scaled(samples.places.reshape(-1, width)).reshape(n, places, width)
    values = samples.values
    units = np.column_stack([model.unit(name, np.nan_to_num(values[:, k])) for k, name in enumerate(DRAWN)])
    number = [bin_numbers(values[:, k], model.tensors[f"bins.{name}"]) for k, name in enumerate(DRAWN)]
    arrays = (scaled.astype(np.float32), units.astype(np.float32), np.column_stack(number))
    return [torch.as_tensor(array) for array in arrays]


def _losses(nets: nn.ModuleDict, batch: list[Tensor]) -> Tensor:
    """Return (n, 6) negative log-likelihoods of the place and of each quantity; 0 where it is unknown."""
    places, units, number = batch
    losses = [-nets["place"](places)[..., 0].log_softmax(1)[:, 0]]
    for k, name in enumerate(DRAWN):
        logits = nets[name](torch.cat([places[:, 0, MOTION], units[:, :k]], dim=1))
        losses.append(nn.functional.cross_entropy(logits, number[:, k], ignore_index=-1, reduction="none"))
    return torch.stack(losses, dim=1)


def train_scenes(
    recordings: Sequence[Recording], *, split: Split, moments: int, seed: int = 0, epochs: int = EPOCHS
) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """Fit a scene model to the training parts of recordings; return its tensors and meta data.

    Args:
        moments: of each site, evenly spread over its recordings.

    Raises:
        TrackError: no scene for training or for validation.
    """
    rng = np.random.default_rng(seed)
    sites = sorted({recording.site for recording in recordings})
    samples: dict[Part, list[SceneSamples]] = {"train": [], "validation": []}
    known: dict[str, list[FloatArray]] = {}
    needs: dict[str, list[FloatArray]] = {}
    of_maps: dict[Path, dict[tuple[str, Part], list[SeedScene]]] = {}
    for site, site_recordings, every_s in loaded_sites(recordings, moments):
        for loaded, part in itertools.product(site_recordings, samples):
            if scenes := part_scenes(loaded, part, split=split, every_s=every_s):
                of_map = of_maps.setdefault(loaded.recording.map_path, {})
                of_map.setdefault((site, part), []).extend(scenes)
    for of_map in of_maps.values():
        inside = seen_cells([scene for scenes in of_map.values() for scene in scenes])
        for (site, part), scenes in of_map.items():
            if drawn := scene_samples(scenes, inside, sites.index(site), rng):
                samples[part].append(drawn)
            if part != "train":
                continue
            assert scenes[0].road is not None
            table = lane_cells(scenes[0].road)
            wholes = [placed_on_lanes(scene, KINDS, rng)[0] for scene in scenes]
            known.setdefault(site, []).append(known_scenes(table, inside, wholes))
            for placed in wholes:
                hardest = needed_deceleration(table, placed, placed).max(axis=1, initial=0.0)
                for name, value in {"deceleration": hardest, **demands(table, placed)}.items():
                    needs.setdefault(name, []).append(value)
    if not samples["train"] or not samples["validation"]:
        raise TrackError("train scenes: needs scenes for training and for validation; give more recordings")
    tensors, loss = fit(
        SceneSamples.join(samples["train"]),
        SceneSamples.join(samples["validation"]),
        [np.concatenate(scenes) for scenes in known.values()],
        seed=seed,
        epochs=epochs,
    )
    count = sum(len(scenes) for m in of_maps.values() for (_, part), scenes in m.items() if part == "train")
    bounds = bounds_of(needs)
    return tensors, {"sites": sites, "scenes": count, "validation_loss": round(loss, 3), "bounds": bounds}


def bounds_of(needs: Mapping[str, Sequence[FloatArray]]) -> dict[str, float]:
    """Return bounds of generated vehicles by name, from ``needs`` of recorded ones (`demands`), (n,) each."""
    bounds = {name: float(np.quantile(np.concatenate(values), USUAL)) for name, values in needs.items()}
    return {**bounds, "lateral": min(bounds["lateral"], MOST_LATERAL_MPS2)}
