"""Meetings of two vehicles with closed forms."""

from __future__ import annotations

import numpy as np

from scex_sumo.certainty.response.motion.blocked import Lines
from scex_sumo.certainty.response.room import Meeting
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.scene import STEP_S, States

LENGTH, WIDTH = 4.0, 2.0


def states(x: float, y: float, heading: float, speed: float) -> States:
    return States(x=np.array([x]), y=np.array([y]), heading=np.array([heading]), speed=np.array([speed]))


def meeting(own: States, other: States, *, seconds: float = 10.0, room: float = 10.0) -> Meeting:
    """Own line straight on; the other one keeps speed and heading."""
    way = other.speed[:, None] * STEP_S * np.arange(round(seconds / STEP_S) + 1)
    return Meeting(
        lines=Lines.straight(own, 300.0),
        speed=own.speed,
        length=np.array([LENGTH]),
        width=np.array([WIDTH]),
        other=Rectangles(
            x=other.x[:, None] + way * np.cos(other.heading)[:, None],
            y=other.y[:, None] + way * np.sin(other.heading)[:, None],
            heading=np.repeat(other.heading[:, None], way.shape[1], axis=1),
            half_length=np.array([[LENGTH / 2]]),
            half_width=np.array([[WIDTH / 2]]),
        ),
        room=np.full((1, 2), room),
    )
