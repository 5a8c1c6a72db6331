"""Scene model: densities of where a next vehicle is and how it moves, given those already there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.schema import record
from scex_sumo.base.tensors import Shape, read_about, read_tensors, save_tensors
from scex_sumo.base.version import __version__
from scex_sumo.generators.scene_context import COLUMNS, ROAD_COLUMNS, SCENE_COLUMNS

FORMAT: Final = "scex-sumo scenes 3"
DRAWN: Final = ("length", "speed", "acceleration", "offset", "turn")
"""Quantities of a vehicle in the order of their draws, each given those before; speed over the mean one."""
MOTION: Final = np.flatnonzero(
    [name in (*SCENE_COLUMNS, "free", "bend", "stop_ahead", "light_ahead") for name in COLUMNS]
)
"""Features of a motion; with all of the road, motions at a new place are those of one recorded site."""
LIKE_DENSITY, LIKE_ROAD, LIKE_PACE = 0.2, 0.15, 0.33  # widths of what is similar; of roads in spreads
NEW_PLACE = 0.4  # spread of the logarithm of the mean speed at a new place that is a junction throughout
OVER_FREE = 1.3  # times the speed without other traffic, the mean speed may be
KINDS: Final = ("car", "truck", "bus", "motorcycle")
SHIPPED: Final = Path(__file__).parent / "data" / "scenes.safetensors"
AGAIN: Final = "train again with: scex-sumo train scenes"


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneModel:
    """Fitted scene model.

    Attributes:
        tensors: by name. ``place.0.weight`` and so on are layers of the networks ``place`` and `DRAWN`;
            ``bins.speed`` (K, 2) the lowest and highest values of its bins; ``width`` (K, Q) quantiles in m
            and ``kind`` (K, 4) shares of `KINDS` for each bin of the length; ``density`` (Q,) quantiles of
            vehicles per km of lane; ``scenes`` (S, 3 + R) logarithms of density and mean speed, mean road
            features, and metres of lanes, of recorded scenes; ``slopes`` (2,) of `usual_pace`; ``mean`` and
            ``spread`` (F,) of the features.
        meta: training command, data, bounds of what counts as about to collide.
    """

    tensors: Mapping[str, NDArray[Any]]
    meta: Mapping[str, Any]

    def network(self, name: str, inputs: FloatArray) -> FloatArray:
        """Return (n, outputs) logits."""
        t, k = self.tensors, 0
        while f"{name}.{k}.weight" in t:
            weight, bias = t[f"{name}.{k}.weight"], t[f"{name}.{k}.bias"]
            inputs = (np.maximum(inputs, 0.0) if k else inputs) @ weight.T + bias
            k += 1
        return inputs

    def scaled(self, features: FloatArray) -> FloatArray:
        """Return features (n, F) in spreads from their means, within 5."""
        scaled = (features.astype(np.float32) - self.tensors["mean"]) / self.tensors["spread"]
        return np.asarray(np.clip(scaled, -5.0, 5.0))

    def place_scores(self, features: FloatArray) -> FloatArray:
        """Return (n,) logarithms of the density of a next vehicle per metre of lane, up to a constant."""
        return np.asarray(self.network("place", self.scaled(features))[:, 0], np.float64)

    def draw(self, features: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """Draw (n,) values of each quantity in `DRAWN`, ``width`` and ``kind`` (number in `KINDS`)."""
        inputs, drawn = self.scaled(features)[:, MOTION], {}
        for name in DRAWN:
            choice = _choose(self.network(name, inputs).astype(np.float64), rng)
            low, high = self.tensors[f"bins.{name}"][choice].T.astype(np.float64)
            drawn[name] = low + (high - low) * rng.random(len(choice))
            inputs = np.column_stack([inputs, self.unit(name, drawn[name])])
            if name == "length":
                quantiles = self.tensors["width"][choice]
                position = rng.random(len(choice)) * (quantiles.shape[1] - 1)
                k, share = position.astype(np.int64), position % 1.0
                rows = np.arange(len(choice))
                drawn["width"] = quantiles[rows, k] * (1 - share) + quantiles[rows, k + 1] * share
                drawn["kind"] = _choose(np.log(self.tensors["kind"][choice] + 1e-9), rng).astype(np.float64)
        return drawn

    def unit(self, name: str, values: FloatArray) -> FloatArray:
        """Return a quantity as an input of the networks, about from -1 to 1."""
        bins = self.tensors[f"bins.{name}"]
        low, high = float(np.quantile(bins, 0.05)), float(np.quantile(bins, 0.95))
        return np.asarray(np.clip(2 * (values - low) / max(high - low, 1e-6) - 1, -3, 3), np.float32)

    def pace(self, road: FloatArray, density: float, total_m: float, rng: np.random.Generator) -> float:
        """Draw the mean speed, m/s: that of a recorded scene with similar roads and density.

        It is scaled by what `usual_pace` says of both scenes. Lanes longer than those of the recorded scene
        have the mean speed of several such scenes. Maps do not tell the lights; so junctions that are unlike
        the recorded ones draw a factor, too. The mean speed is at most 1.3 times the speed without other
        traffic, and above that at most the highest recorded one.

        Args:
            road: (R,) mean `ROAD_COLUMNS` of the lanes.
            density: vehicles per km of lane.
            total_m: length of the lanes, m.
        """
        scenes, slopes = (self.tensors[name].astype(np.float64) for name in ("scenes", "slopes"))
        dense = np.clip(np.log(density), scenes[:, 0].min(), scenes[:, 0].max())
        target = np.array([[dense, 0.0, *road, total_m]])
        scale = usual_pace(target, slopes) - usual_pace(scenes, slopes)
        spread = self.tensors["spread"][1 : len(road)]  # without the free speed, which scales
        roads = (((scenes[:, 3:-1] - road[1:]) / spread) ** 2).mean(axis=1) / LIKE_ROAD**2
        away = ((scenes[:, 0] - dense) / LIKE_DENSITY) ** 2 + roads + (scale / LIKE_PACE) ** 2
        chosen = _choose(-away[None] / 2, rng)
        parts = max(round(total_m / scenes[chosen[0], -1]), 1)
        chosen = np.append(chosen, _choose(np.tile(-away / 2, (parts - 1, 1)), rng))
        unlike = NEW_PLACE * (1.0 - np.exp(-roads.min() / 2)) * pace_terms(target)[0, 0]
        free, fastest = float(10.0 * road[0]), float(np.exp(scenes[:, 1].max()))
        pace = float(np.exp(scenes[:, 1] + scale)[chosen].mean() * np.exp(unlike * rng.standard_normal()))
        return min(pace, OVER_FREE * free, max(free, fastest))

    def count(self, total_m: float, rng: np.random.Generator) -> int:
        """Draw the number of vehicles on a length of lanes; at least 2, as recorded scenes have."""
        density = np.quantile(self.tensors["density"], rng.random())
        return max(2, round(float(density) * total_m / 1000.0))


def usual_pace(scenes: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the logarithm of the mean speed (S,) that road and density let expect, up to a constant.

    It is the speed without other traffic, less for roads with many conflicts and for dense traffic.

    Args:
        scenes: (S, 3 + R) as in `SceneModel`.
        slopes: (2,) of `pace_terms`.
    """
    free = scenes[:, 2 + ROAD_COLUMNS.index("free")]
    return np.asarray(np.log(np.maximum(free, 0.1)) + pace_terms(scenes) @ slopes)


def pace_terms(scenes: FloatArray) -> FloatArray:
    """Return (S, 2) c / (1 + c) of the conflicts c per lane, and densities in vehicles per metre of lane."""
    conflicts = scenes[:, 2 + ROAD_COLUMNS.index("conflicts")]
    return np.column_stack([conflicts / (1.0 + conflicts), np.exp(scenes[:, 0]) / 1000.0])


def _choose(logits: FloatArray, rng: np.random.Generator) -> IntArray:
    return np.asarray((logits + rng.gumbel(size=logits.shape)).argmax(axis=1))


def save_scenes(path: Path, tensors: Mapping[str, FloatArray], meta: Mapping[str, Any]) -> None:
    """Write a scene model; ``meta`` holds plain values."""
    about = {"format": FORMAT, "version": __version__, "columns": COLUMNS, "meta": dict(meta)}
    save_tensors(path, tensors, about)


@lru_cache(maxsize=2)
def load_scenes(path: Path = SHIPPED) -> SceneModel:
    """Read a scene model; the shipped one by default.

    Raises:
        InputError: the file is missing, no scene model, or one for other features.
    """
    about = read_about(path, _ABOUT, AGAIN)
    tensors = read_tensors(path, _shapes, AGAIN)
    for name, least in _LEAST.items():
        if not (tensors[name] >= least).all():
            raise InputError(f"{path}: {name} has values below {least:g}; {AGAIN}")
    return SceneModel(tensors=tensors, meta={**about["meta"], "sha256": sha256_of(path)})


_ABOUT: Final = record(
    {"format": {"const": FORMAT}, "columns": {"const": [*COLUMNS]}, "meta": {"type": "object"}}
)
_LEAST: Final = dict.fromkeys(("kind", "density", "bins.speed"), 0.0) | {"spread": 1e-6}


def _shapes(given: Mapping[str, Shape]) -> dict[str, Shape]:
    """Return the shapes of all tensors; as many bins, quantiles and numbers within a network as in a file."""
    inputs = {"place": len(COLUMNS)} | {name: len(MOTION) + k for k, name in enumerate(DRAWN)}
    bins = {name: given[f"bins.{name}"][0] for name in DRAWN}
    shapes: dict[str, Shape] = {f"bins.{name}": (count, 2) for name, count in bins.items()}
    for name, size in inputs.items():
        layers = sum(tensor.startswith(f"{name}.") and tensor.endswith(".bias") for tensor in given)
        for k in range(layers):
            last = k == layers - 1
            outputs = bins.get(name, 1) if last else given[f"{name}.{k}.bias"][0]
            shapes |= {f"{name}.{k}.weight": (outputs, size), f"{name}.{k}.bias": (outputs,)}
            size = outputs
    shapes |= {"mean": (len(COLUMNS),), "spread": (len(COLUMNS),), "slopes": (2,)}
    shapes |= {"kind": (bins["length"], len(KINDS)), "width": (bins["length"], given["width"][-1])}
    return shapes | {"density": given["density"], "scenes": (given["scenes"][0], 3 + len(ROAD_COLUMNS))}
