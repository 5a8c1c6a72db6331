"""A crossing drawn twice by hand, as road and as SUMO net that agree, so that a test can spoil the net.

Lanelet 1 comes from the west and crosses (2) to the east (3); 7 lies left of 1 and turns left (8) into 6; 4
comes from the south and crosses (5) to the north (6), and gives way. Cars may change from 7 to 1, not back. 9
is a walkway beside 4.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from scex_sumo.road import Lane, Regulation, Road
from tests.seeds import lane_along

LIMIT = 13.89
TURN = [(-15.0, 3.5), (-10.0, 3.6), (-5.0, 5.0), (-1.5, 8.5), (-0.2, 12.0), (0.0, 15.0)]

NET = """<net version="1.20">
<location netOffset="0.00,0.00" convBoundary="-60,-60,60,60" origBoundary="-60,-60,60,60" projParameter="!"/>
<edge id=":J_0" function="internal">
<lane id=":J_0_0" index="0" speed="13.89" length="30.00" width="3.50" shape="-15.00,0.00 15.00,0.00"/></edge>
<edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="13.89" length="21.88" width="3.50"
 shape="-15.00,3.50 -10.00,3.60 -5.00,5.00 -1.50,8.50 -0.20,12.00 0.00,15.00"/></edge>
<edge id=":J_2" function="internal">
<lane id=":J_2_0" index="0" speed="13.89" length="30.00" width="3.50" shape="0.00,-15.00 0.00,15.00"/></edge>
<edge id="west" from="W" to="J" priority="1">
<lane id="west_0" index="0" speed="13.89" length="45" width="3.5" shape="-60,0 -15,0" changeLeft="authority"/>
<lane id="west_1" index="1" speed="13.89" length="45.00" width="3.50" shape="-60.00,3.50 -15.00,3.50"/></edge>
<edge id="south" from="S" to="J" priority="1">
<lane id="south_0" index="0" speed="13.89" length="45.00" width="3.50" shape="0.00,-60.00 0,-15.00"/></edge>
<edge id="east" from="J" to="E" priority="1">
<lane id="east_0" index="0" speed="13.89" length="45.00" width="3.50" shape="15.00,0.00 60.00,0.00"/></edge>
<edge id="north" from="J" to="N" priority="1">
<lane id="north_0" index="0" speed="13.89" length="45.00" width="3.50" shape="0.00,15.00 0.00,60.00"/></edge>
<junction id="J" type="priority" x="0" y="0" incLanes="west_0 west_1 south_0" intLanes=":J_0_0 :J_1_0 :J_2_0"
 shape="-15,-2 -15,5.5 -2,15 2,15 15,2 15,-2 2,-15 -2,-15">
<request index="0" response="000" foes="100" cont="0"/>
<request index="1" response="000" foes="100" cont="0"/>
<request index="2" response="011" foes="011" cont="0"/>
</junction>
<junction id="W" type="dead_end" x="-60" y="0" incLanes="" intLanes="" shape="-60,-2 -60,5 -60.1,0"/>
<junction id="S" type="dead_end" x="0" y="-60" incLanes="" intLanes="" shape="-2,-60 2,-60 0,-60.1"/>
<junction id="E" type="dead_end" x="60" y="0" incLanes="east_0" intLanes="" shape="60,-2 60,2 60.1,0"/>
<junction id="N" type="dead_end" x="0" y="60" incLanes="north_0" intLanes="" shape="-2,60 2,60 0,60.1"/>
<connection from="west" to="east" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="M"/>
<connection from="west" to="north" fromLane="1" toLane="0" via=":J_1_0" dir="l" state="M"/>
<connection from="south" to="north" fromLane="0" toLane="0" via=":J_2_0" dir="s" state="m"/>
<connection from=":J_0" to="east" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":J_1" to="north" fromLane="0" toLane="0" dir="l" state="M"/>
<connection from=":J_2" to="north" fromLane="0" toLane="0" dir="s" state="M"/>
</net>
"""


class Table:
    """Which SUMO lane stands for which lanelet of the crossing."""

    lanes: ClassVar[dict[int, str]] = {
        1: "west_0",
        7: "west_1",
        2: ":J_0_0",
        8: ":J_1_0",
        5: ":J_2_0",
        4: "south_0",
        3: "east_0",
        6: "north_0",
    }

    def sumo_lanes(self, lanelet_id: int) -> tuple[str, ...]:
        name = self.lanes.get(lanelet_id)
        return () if name is None else (name,)


def lane(lane_id: int, points: list[tuple[float, float]], **fields: object) -> Lane:
    """A lanelet of constant width around a centreline."""
    return lane_along(lane_id, points, **{"speed_limit_mps": LIMIT, "subtype": "road", **fields})


def crossing() -> Road:
    """The road that ``NET`` is faithful to."""
    lanes = [
        lane(1, [(-60, 0), (-15, 0)], successors=(2,), adjacent_left=7),
        lane(2, [(-15, 0), (15, 0)], successors=(3,), predecessors=(1,), conflicts=(5,)),
        lane(3, [(15, 0), (60, 0)], predecessors=(2,)),
        lane(4, [(0, -60), (0, -15)], successors=(5,)),
        lane(5, [(0, -15), (0, 15)], successors=(6,), predecessors=(4,), conflicts=(2, 8)),
        lane(6, [(0, 15), (0, 60)], predecessors=(5, 8)),
        lane(7, [(-60, 3.5), (-15, 3.5)], successors=(8,), right=1, adjacent_right=1),
        lane(8, TURN, successors=(6,), predecessors=(7,), conflicts=(5,)),
        lane(9, [(4, -60), (4, -15)], width=2.0, kind="pedestrian", subtype="walkway"),
    ]
    rule = Regulation(element_id=90, kind="right_of_way", lanes=(5, 2, 8), yielding=(5,), priority=(2, 8))
    return Road(name="crossing", lanes={one.lane_id: one for one in lanes}, regulations=(rule,))


def write_net(folder: Path, *edits: tuple[str, str]) -> Path:
    """The net with each (old, new) text replaced; an old text that is not there is a mistake of the test."""
    text = NET
    for old, new in edits:
        if old not in text:
            raise ValueError(f"not in the net: {old}")
        text = text.replace(old, new)
    path = folder / "crossing.net.xml"
    path.write_text(text, encoding="utf-8")
    return path
