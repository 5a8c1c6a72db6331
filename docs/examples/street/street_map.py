"""Maps of centrelines in JSON, m: {"lanes": {"1": {"line": [...], "width": 3.5, "kmh": 50, "next": []}}}."""

import json

import numpy as np

import scex_sumo as scex


def is_mine(path):
    return path.name.endswith(".street.json")


def name(path):
    return path.name.removesuffix(".street.json")


def read(path, *, origin=None, **options):
    lanes = {int(number): lane for number, lane in json.loads(path.read_text())["lanes"].items()}
    before = {number: tuple(k for k, lane in lanes.items() if number in lane["next"]) for number in lanes}
    return scex.Road(
        name=name(path),
        lanes={
            number: scex.Lane(
                lane_id=number,
                centreline=np.array(lane["line"], float),
                left_bound=shifted(lane["line"], lane["width"] / 2),
                right_bound=shifted(lane["line"], -lane["width"] / 2),
                width_m=lane["width"],
                speed_limit_mps=lane["kmh"] / 3.6,
                successors=tuple(lane["next"]),
                predecessors=before[number],
            )
            for number, lane in lanes.items()
        },
    )


def shifted(line, left):
    """Return a line moved to the left by some metres."""
    points = np.array(line, float)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return points + left * np.stack([-along[:, 1], along[:, 0]], axis=1)
