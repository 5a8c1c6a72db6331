"""Lane change under way that a SUMO driver goes on with, as the simulation it comes from had it.

SUMO cannot begin in the middle of a change: its own saved states end it in the first step, on the wrong
lane. So the vehicle is moved sideways step by step, and makes no other change until it is there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scex_sumo.scene import STEP_S

_NO_CHANGES = 0  # SUMO's lane change mode


@dataclass(kw_only=True, eq=False)
class LaneChange:
    """Lane change under way.

    Attributes:
        key: SUMO's id of the vehicle.
        speed_mps: lateral, positive to the left.
        offset_m: lateral offset from the middle of the lane that SUMO has the vehicle on.
        limit_m: greatest offset, where no lane is beside.
        mode: SUMO's lane change mode after it.
    """

    key: str
    speed_mps: float
    offset_m: float
    limit_m: float
    mode: int

    @classmethod
    def of(cls, sumo: Any, key: str, speed_mps: float) -> LaneChange:
        """Return the change of a vehicle; raises SUMO's error if no lane is where it goes."""
        ask, side = sumo.vehicle, 1 if speed_mps > 0 else -1
        lane, offset, mode = ask.getLaneID(key), ask.getLateralLanePosition(key), ask.getLaneChangeMode(key)
        limit = sumo.lane.getWidth(lane)
        if side * offset >= 0:
            limit = (limit + sumo.lane.getWidth(_beside(ask, key, lane, side))) / 2
        ask.setLaneChangeMode(key, _NO_CHANGES)
        return cls(key=key, speed_mps=speed_mps, offset_m=offset, limit_m=limit, mode=mode)

    def switch(self, sumo: Any) -> None:
        """Before a step: put the vehicle on its new lane once its body has left the old one.

        Until then it follows its old leader, as in SUMO. Raises SUMO's error if no lane is there.
        """
        ask, lane = sumo.vehicle, sumo.vehicle.getLaneID(self.key)
        half, side = sumo.lane.getWidth(lane) / 2, 1 if self.speed_mps > 0 else -1
        if side * self.offset_m > half + ask.getWidth(self.key) / 2:
            beside = _beside(ask, self.key, lane, side)
            ask.moveTo(self.key, beside, ask.getLanePosition(self.key))
            self.offset_m -= side * (half + sumo.lane.getWidth(beside) / 2)

    def go_on(self, sumo: Any) -> bool:
        """Set the offset after a step; return whether the change goes on."""
        side = 1 if self.speed_mps > 0 else -1
        offset = side * (self.offset_m + self.speed_mps * STEP_S)
        done = side * self.offset_m < 0 <= offset
        self.offset_m = 0.0 if done else side * min(offset, self.limit_m)
        if done:
            sumo.vehicle.setLaneChangeMode(self.key, self.mode)
        sumo.vehicle.setLateralLanePosition(self.key, self.offset_m)
        return not done


def _beside(vehicles: Any, key: str, lane: str, side: int) -> str:
    return f"{lane.rpartition('_')[0]}_{vehicles.getLaneIndex(key) + side}"
