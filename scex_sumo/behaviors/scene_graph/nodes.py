"""Nodes of the semantic scene graph: what is known of each vehicle by itself."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.scene_graph.edges import Located
from scex_sumo.geometry.frames import SEEN_COLUMNS, seen_from
from scex_sumo.geometry.polylines import wrap
from scex_sumo.roads.index import RoadIndex
from scex_sumo.scene import STEP_S, SceneHistory

TYPES = ("car", "truck", "motorcycle", "other")
NODE_COLUMNS = (
    "length",  # m
    "width",
    *(f"is_{kind}" for kind in TYPES),
    "speed",  # m/s
    "yaw_rate",  # rad/s
    "acceleration",  # m/s²
    "match_probability",  # of the most probable lane; 0 off the road, and so the next three
    "lane_offset",  # m, from the centreline, left positive
    "lane_heading_error",  # rad, vehicle minus lane
    "speed_limit",  # m/s, of the lane
    "obstacle_ahead",  # 1 if a pedestrian or cyclist is in the corridor ahead, else 0, and so the next two
    "obstacle_distance",  # m, from the front bumper to the obstacle's centre
    "obstacle_offset",  # m, left positive
)
HISTORY_COLUMNS = SEEN_COLUMNS
SLOPE_STEPS = 5  # 0.5 s
CORRIDOR_M = 30.0  # ahead of the front bumper: where a car at 50 km/h stops comfortably
CORRIDOR_HALF_WIDTH_M = 3.0  # to either side: the own lane, and who stands at its edge
_WORDS = {"motor": 2, "truck": 1, "bus": 1, "trailer": 1, "car": 0, "van": 0}


def node_history(history: SceneHistory) -> FloatArray:
    """(C * V, 11, 5) the last second in each vehicle's present frame, columns as in `HISTORY_COLUMNS`."""
    seen = seen_from(history.now, history.states)
    return seen.reshape(-1, *seen.shape[2:])


def node_features(history: SceneHistory, place: Located, index: RoadIndex) -> FloatArray:
    """(C * V, F) columns as in `NODE_COLUMNS`.

    Args:
        place: lanes of the C * V vehicles.
    """
    children, vehicles = history.now.shape
    features = np.zeros((children, vehicles, len(NODE_COLUMNS)))
    scene = history.scene
    features[..., 0], features[..., 1] = scene.length, scene.width
    kind = np.array([_type_of(name) for name in scene.types], dtype=np.int64)
    features[..., 2:6] = kind[:, None] == np.arange(len(TYPES))
    recent = slice(-SLOPE_STEPS - 1, None)
    features[..., 6] = history.now.speed
    features[..., 7] = slope(wrap(history.states.heading[..., recent] - history.now.heading[..., None]))
    features[..., 8] = slope(history.states.speed[..., recent])
    known = place.probability[0] > 0
    flat = features.reshape(-1, len(NODE_COLUMNS))
    flat[:, 9], flat[:, 10], flat[:, 11] = place.probability[0], place.offset[0], place.heading_error[0]
    flat[known, 12] = index.speed_limit[place.lane[0, known]]
    features[..., 13:] = _obstacle_ahead(history)
    return flat


def _type_of(name: str) -> int:
    """Index into `TYPES` of a recorded type, e.g. ``truck_bus``; a word inside the name decides."""
    return next((number for word, number in _WORDS.items() if word in name.lower()), TYPES.index("other"))


def slope(values: FloatArray) -> FloatArray:
    """Change per second of evenly spaced values (..., K): the median of the slopes of all pairs of them.

    One outlier among six values changes nothing of note (Theil 1950, Sen 1968).
    """
    first, second = np.triu_indices(values.shape[-1], 1)
    slopes = (values[..., second] - values[..., first]) / ((second - first) * STEP_S)
    median: FloatArray = np.median(slopes, axis=-1)
    return median


def _obstacle_ahead(history: SceneHistory) -> FloatArray:
    """(C, V, 3) whether a pedestrian or cyclist is in the corridor ahead, and the nearest one's place."""
    now, obstacles, present = history.now, history.obstacle_states, history.obstacle_present
    found = np.zeros((*now.shape, 3))
    if obstacles is None or present is None or not present.any():
        return found
    dx, dy = obstacles.x[present] - now.x[..., None], obstacles.y[present] - now.y[..., None]
    cos, sin = np.cos(now.heading)[..., None], np.sin(now.heading)[..., None]
    distance = cos * dx + sin * dy - history.scene.length[:, None] / 2
    offset = cos * dy - sin * dx
    inside = (distance >= 0) & (distance <= CORRIDOR_M) & (np.abs(offset) <= CORRIDOR_HALF_WIDTH_M)
    child, vehicle = np.nonzero(inside.any(axis=-1))
    nearest = np.where(inside, distance, np.inf)[child, vehicle].argmin(axis=-1)
    found[child, vehicle, 0] = 1.0
    found[child, vehicle, 1] = distance[child, vehicle, nearest]
    found[child, vehicle, 2] = offset[child, vehicle, nearest]
    return found
