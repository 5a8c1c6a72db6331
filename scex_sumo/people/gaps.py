"""Gap acceptance: where people wait for a vehicle, if one comes too soon after they would have crossed.

A person looks at each vehicle as if both kept their velocity. In the frame of the vehicle, the person crosses
a band as wide as both and a margin from t_in to t_out; the vehicle is there from t_from to t_to. The person
goes first if t_out + g <= t_from, and behind it if t_to + b <= t_in; else it waits before the band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.people.parameters import PeopleParameters
from scex_sumo.scene import SceneHistory, VehicleIndex

MIN_SPEED_MPS = 0.05  # slower motion does not cross anything


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting:
    """Times at which n people and J vehicles are where their ways cross, (n, J), s; NaN where they do not."""

    enters: FloatArray  # the person enters the way of the vehicle; negative: is in it
    leaves: FloatArray
    arrives: FloatArray  # the vehicle arrives
    left: FloatArray

    def yields(self, gap_s: FloatArray, behind_s: float) -> BoolArray:
        """Return whether (n, J) people let a vehicle pass, by the gaps (n,) that they accept."""
        first = self.leaves + gap_s[:, None] <= self.arrives
        behind = self.left + behind_s <= self.enters
        return np.isfinite(self.enters) & ~first & ~behind


def meetings(
    history: SceneHistory, who: VehicleIndex, speed: FloatArray, heading: FloatArray, people: PeopleParameters
) -> Meeting:
    """Return when people that walk on with a speed and direction (n,) and vehicles are where they cross."""
    scene, now = history.scene, history.now
    vehicles = np.arange(scene.vehicles) if scene.people is None else np.flatnonzero(~scene.people)
    me = now[who.future, who.vehicle].map(lambda values: values[:, None])
    other = now[:, vehicles][who.future]
    cos, sin = np.cos(other.heading), np.sin(other.heading)
    dx, dy = me.x - other.x, me.y - other.y
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    turn = heading[:, None] - other.heading
    closing = other.speed - speed[:, None] * np.cos(turn)
    across = speed[:, None] * np.sin(turn)
    size = (scene.length[who.vehicle] + scene.width[who.vehicle])[:, None] / 4
    half_width = scene.width[vehicles] / 2 + size + people.margin_m
    half_length = scene.length[vehicles] / 2 + size
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = (-np.sign(across) * aside - half_width) / np.abs(across)
        leaves = (-np.sign(across) * aside + half_width) / np.abs(across)
        arrives = (ahead - half_length) / closing
        left = (ahead + half_length) / closing
    # One that closes in from in front; from behind, the person catches up with it.
    arrives, left = np.minimum(arrives, left), np.maximum(arrives, left)
    crosses = (np.abs(across) > MIN_SPEED_MPS) & (leaves > 0) & (enters < people.look_s)
    crosses &= (left > 0) & (arrives < people.look_s + 2.0) & (np.abs(closing) > MIN_SPEED_MPS)
    nothing = np.where(crosses, 0.0, np.nan)
    return Meeting(
        enters=enters + nothing, leaves=leaves + nothing, arrives=arrives + nothing, left=left + nothing
    )


def waiting_way(
    met: Meeting, speed: FloatArray, gap_s: FloatArray, people: PeopleParameters
) -> tuple[FloatArray, BoolArray]:
    """Return the way (n,) to where people wait, m, inf if they need not, and who is in a vehicle's way.

    Who is in a band, or cannot stop before it, goes on.
    """
    yields = met.yields(gap_s, people.behind_s)
    way = met.enters * speed[:, None] - people.stop_m
    can = way + people.stop_m >= speed[:, None] ** 2 / (2 * people.braking_mps2)
    stops = yields & can & (met.enters > 0)
    wait = np.where(stops, np.maximum(way, 0.0), np.inf).min(axis=1, initial=np.inf)
    soon = yields & ~can & (met.arrives > 0)
    return wait, np.asarray(soon.any(axis=1))
