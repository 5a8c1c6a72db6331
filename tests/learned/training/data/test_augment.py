"""A scene seen in a mirror is the scene of the mirrored road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from scex_sumo.learned.training.data.batches import Batch, Batches, mirrored  # noqa: E402
from scex_sumo.learned.training.data.samples import scene_samples  # noqa: E402
from scex_sumo.scene import SeedScene, States  # noqa: E402
from tests.behaviors import roads  # noqa: E402

RADIUS = 60.0


def curve(side: int) -> Batch:
    """Two vehicles behind one another, off the middle of a curve to the left (1) or right (-1)."""
    where = roads.road(roads.lane(1, roads.arc(RADIUS, side * np.pi, step=0.5)))
    angle = np.array([0.3, 0.7])
    inner = RADIUS - 0.4  # 0.4 m off the middle, to the inside

    def at(time: np.ndarray) -> States:
        turned = angle[:, None] + 10.0 * time / RADIUS
        return States(
            x=inner * np.sin(turned),
            y=side * (RADIUS - inner * np.cos(turned)),
            heading=side * turned,
            speed=np.full(turned.shape, 10.0),
        )

    scene = roads.scene_of(*((0.0, 0.0, 0.0, 10.0),) * 2)
    future = at(0.1 * np.arange(1, 51))
    scene = replace(
        scene, history=at(0.1 * np.arange(-10, 1)), future=future, future_valid=np.ones((2, 50), dtype=bool)
    )
    return batch_of(scene, where)


def batch_of(scene: SeedScene, where: roads.Road) -> Batch:
    samples = scene_samples(scene, where, scene.history.repeat(1))
    assert samples is not None
    return Batches(samples, np.ones(1), torch.device("cpu")).take(np.array([0]))


def tensors(batch: Batch) -> dict[str, torch.Tensor]:
    found = {**batch.scene._asdict(), "features": batch.path.features}
    return found | {name: getattr(batch, name) for name in ("pose", "s", "d", "start", "xy")}


def test_a_curve_to_the_left_becomes_one_to_the_right() -> None:
    left, right = tensors(mirrored(curve(1))), tensors(curve(-1))
    assert right["edge"].shape[0] == 2  # each sees the other
    assert float(right["d"].mean()) == pytest.approx(-0.4, abs=0.05)  # the inside is right of the path
    for name, values in right.items():
        # The grid of the drivable surface has cells of 0.25 m, which do not lie in the mirror.
        loose = 0.5 if name == "features" else 2e-3
        np.testing.assert_allclose(left[name], values, atol=loose, err_msg=name)
