"""Image branch of the Graph Image Predictor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.learned.inputs.raster import CHANNELS, PIXEL_M, Raster
from scex_sumo.learned.network.architecture import (
    AHEAD_M,
    ASIDE_M,
    CONVOLUTIONS,
    COS,
    FEATURES,
    SIN,
    STRIDE,
    Convolution,
)
from scex_sumo.learned.network.layers import Mlp, State, relu, snapped

PLACES = 64  # at a time, which fit the processor's cache
STRIP, HALO = 128, 16  # rows of a map at a time, and rows around them that convolutions reach


class MapImage(NamedTuple):
    """Raster and features of a map, each with a border of zeros."""

    raster: FloatArray  # (7, R + 2, C + 2), see `Raster`
    features: FloatArray  # (10, R' + 2, C' + 2) of `ImageEncoder.features_of`
    corner: FloatArray  # (2,) m, of the raster's first pixel

    @classmethod
    def of(cls, raster: Raster, features: FloatArray) -> MapImage:
        """Frame a raster and its (10, R', C') features."""
        return cls(_framed(raster.values), _framed(features), raster.corner)


class ImageEncoder:
    """Encoder of the road around a vehicle."""

    def __init__(self, state: State) -> None:
        weights = (state[f"image.convolve.{2 * index}.weight"] for index in range(len(CONVOLUTIONS)))
        self.weights = [w.transpose(2, 3, 1, 0).reshape(-1, len(w)) for w in weights]
        self.biases = [state[f"image.convolve.{2 * index}.bias"] for index in range(len(CONVOLUTIONS))]
        grid = np.stack(np.meshgrid(AHEAD_M, ASIDE_M, indexing="ij"), axis=-1).reshape(-1, 2)
        self.ahead, self.aside = grid.T
        self.read = Mlp(state, "image.read")

    def features_of(self, raster: Raster) -> FloatArray:
        """Return (10, R', C') features of a map, strip by strip to limit the memory."""
        values = raster.values.transpose(1, 2, 0)
        strips = []
        for first in range(0, len(values), STRIP):
            top = max(first - HALO, 0)
            strip, start = self.features(values[top : first + STRIP + HALO]), (first - top) // STRIDE
            strips.append(strip[start : start + STRIP // STRIDE])
        return np.concatenate(strips).transpose(2, 0, 1)

    def features(self, values: FloatArray) -> FloatArray:
        """Return (R', C', 10) of (R, C, 7)."""
        for layer, weight, bias in zip(CONVOLUTIONS, self.weights, self.biases, strict=True):
            values = relu(values) if layer is not CONVOLUTIONS[0] else values
            values = _convolved(snapped(values), layer, weight)
            values += bias
        return snapped(values)

    def __call__(self, image: MapImage, pose: FloatArray) -> FloatArray:
        """Return (K, hidden) of (K, 3) places x, y, heading on the map, m and rad."""
        firsts = range(0, max(len(pose), 1), PLACES)
        return np.concatenate([self._read(image, pose[first : first + PLACES]) for first in firsts])

    def _read(self, image: MapImage, pose: FloatArray) -> FloatArray:
        x, y, heading = (column[:, None] for column in pose.T)
        cos, sin = np.cos(heading), np.sin(heading)
        u = (x + cos * self.ahead - sin * self.aside - image.corner[0]) / PIXEL_M
        v = (y + sin * self.ahead + cos * self.aside - image.corner[1]) / PIXEL_M
        seen = np.empty((len(pose), len(CHANNELS) + FEATURES, len(self.ahead)))
        seen[:, : len(CHANNELS)] = _sampled(image.raster, u, v)
        seen[:, len(CHANNELS) :] = _sampled(image.features, u / STRIDE, v / STRIDE)
        along, across = seen[:, COS].copy(), seen[:, SIN].copy()
        # directions of lanes relative to the vehicle's
        seen[:, COS] = cos * along + sin * across
        seen[:, SIN] = cos * across - sin * along
        return self.read(seen.reshape(len(pose), -1))


def _framed(values: FloatArray) -> FloatArray:
    return np.pad(values, ((0, 0), (1, 1), (1, 1)))


def _convolved(values: FloatArray, layer: Convolution, weight: FloatArray) -> FloatArray:
    pad, step, apart = layer.padding, layer.stride, layer.dilation
    padded = np.pad(values, ((pad, pad), (pad, pad), (0, 0)))
    reach = apart * (layer.side - 1)
    rows, columns = ((size - reach - 1) // step + 1 for size in padded.shape[:2])
    windows = np.empty((rows, columns, layer.side**2, layer.inner))
    for k in range(layer.side**2):
        i, j = (apart * at for at in divmod(k, layer.side))
        windows[:, :, k] = padded[i : i + step * rows : step, j : j + step * columns : step]
    products: FloatArray = windows.reshape(rows * columns, -1) @ weight
    return products.reshape(rows, columns, -1)


def _sampled(framed: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    channels, rows, columns = framed.shape
    u, v = np.clip(u + 1, 0, columns - 1), np.clip(v + 1, 0, rows - 1)
    j = np.minimum(u.astype(np.int64), columns - 2)
    i = np.minimum(v.astype(np.int64), rows - 2)
    fj, fi = u - j, v - i
    flat, at = framed.reshape(channels, -1), i * columns + j
    values: FloatArray = flat.take(at, axis=1, mode="clip") * ((1 - fi) * (1 - fj))
    for beside, share in ((1, (1 - fi) * fj), (columns, fi * (1 - fj)), (columns + 1, fi * fj)):
        corner = flat.take(at + beside, axis=1, mode="clip")
        corner *= share
        values += corner
    return values.swapaxes(0, 1)
