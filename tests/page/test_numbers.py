"""What the page computes itself is what the library computes."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest
from shapely import Polygon
from shapely.affinity import rotate, translate

from scex_sumo.page.html import asset
from scex_sumo.page.packing import pack
from scex_sumo.statistics.density import density, split_atoms
from tests.statistics.shares import wilson

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="no node: apt-get install nodejs")


def evaluated(scripts: tuple[str, ...], expression: str) -> Any:
    """Value of an expression, or of a promise, after some of our scripts."""
    lines = [*(asset(name) for name in scripts)]
    lines.append(f"Promise.resolve({expression}).then((found) => console.log(JSON.stringify(found)));")
    done = subprocess.run(
        [str(NODE), "-"], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_packed_arrays_are_read() -> None:
    text = pack({"name": "größer"}, {"wide": np.array([[1, -2], [300, 4]]), "real": np.array([0.5, -1.25])})
    found = evaluated(
        ("data.js",),
        f"unpack({json.dumps(text)}).then(({{ info, arrays: {{ wide, real }} }}) => "
        "[info.name, wide.shape, [...wide.values], [...real.values]])",
    )
    assert found == ["größer", [2, 2], [1, -2, 300, 4], [0.5, -1.25]]


def test_densities_of_a_selection_are_those_of_the_library() -> None:
    rng = np.random.default_rng(1)
    samples = np.concatenate([rng.gamma(2, 1, 60).round(3), np.full(20, 1.5), np.zeros(9)])
    x = np.linspace(-0.5, 6, 50)
    atoms, rest = split_atoms(samples)
    found = evaluated(
        ("data.js", "chart.js"),
        f"curveOf({samples.tolist()}, {len(samples)}, {x.tolist()}, 0.1, true, {[a.value for a in atoms]})",
    )
    assert len(atoms) == 2
    assert found["atoms"] == [pytest.approx([atom.value, atom.share]) for atom in atoms]
    grid, pdf, below = np.array(found["points"]).T
    assert grid.min() >= 0
    expected = density(rest, x=grid, reflect=True).pdf * len(rest) / len(samples)
    np.testing.assert_allclose(pdf, expected, atol=1e-7)
    np.testing.assert_allclose(below, [(samples <= value).mean() for value in grid])


@pytest.mark.parametrize(("successes", "count"), [(0, 10), (3, 10), (10, 10), (126, 385)])
def test_intervals_are_those_of_the_library(successes: int, count: int) -> None:
    found = evaluated(("data.js",), f"interval({successes} / {count}, {count})")
    expected = wilson(successes, count)
    assert [found["value"], found["low"], found["high"]] == pytest.approx(
        [expected.value, expected.low, expected.high], abs=1e-6
    )


def test_gaps_are_those_of_rectangles() -> None:
    rng = np.random.default_rng(2)
    poses = rng.uniform([-6, -6, -3], [6, 6, 3], (40, 2, 3))
    sizes = rng.uniform([3, 1.5], [12, 2.5], (40, 2, 2))
    expected = [
        body(pose[0], size[0]).distance(body(pose[1], size[1]))
        for pose, size in zip(poses, sizes, strict=True)
    ]
    rows = [[p[0], s[0], p[1], s[1]] for p, s in zip(poses.tolist(), sizes.tolist(), strict=True)]
    found = evaluated(("data.js", "pairs.js"), f"{json.dumps(rows)}.map((row) => bodyGap(...row))")
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert min(expected) == 0 < max(expected)


def test_times_to_collision_are_those_of_moved_rectangles() -> None:
    rng = np.random.default_rng(3)
    poses = rng.uniform([-15, -15, -3, 0], [15, 15, 3, 12], (40, 2, 4))
    sizes = rng.uniform([3, 1.5], [12, 2.5], (40, 2, 2))
    times = np.arange(0, 4, 0.01)
    rows = [[p[0], s[0], p[1], s[1]] for p, s in zip(poses.tolist(), sizes.tolist(), strict=True)]
    found = evaluated(
        ("data.js", "pairs.js"), f"{json.dumps(rows)}.map((row) => Math.min(timeToCollision(...row), 99))"
    )
    hits = 0
    for pose, size, time_s in zip(poses, sizes, found, strict=True):
        velocity = pose[:, 3:] * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
        bodies = [body(pose[i], size[i]) for i in range(2)]
        touch = [
            t for t in times if translate(bodies[0], *(t * (velocity[0] - velocity[1]))).intersects(bodies[1])
        ]
        assert time_s == pytest.approx(touch[0], abs=0.011) if touch else time_s > 3.98
        hits += bool(touch) and touch[0] > 0
    assert hits > 3


def body(pose: np.ndarray, size: np.ndarray) -> Polygon:
    length, width = size / 2
    box = Polygon([(length, width), (length, -width), (-length, -width), (-length, width)])
    return translate(rotate(box, pose[2], origin=(0, 0), use_radians=True), pose[0], pose[1])
