"""Actor controller for CARLA's ScenarioRunner: replays a future, setting the transform at each tick.

ScenarioRunner drives FollowTrajectoryAction through a local planner, which is late and cuts curves. Assign
this controller to each entity instead (AssignControllerAction with a Controller whose properties are
``module`` = path of this file and ``file`` = path of the .xosc), or call `run_step` from a script of yours.
The actor's role name is the entity's, e.g. ``vehicle17``. Written for the interface of CARLA 0.9.15 and
ScenarioRunner 0.9.15 as documented; tested against a stand-in of it, never against CARLA itself.
"""

import bisect
import math
from xml.etree import ElementTree

import carla
from srunner.scenariomanager.actorcontrols.basic_control import BasicControl


def read_boxes(file, name):
    """Times, and x, y, heading of the middle of an entity's box; and how far the box's middle is ahead."""
    root = ElementTree.parse(file).getroot()
    entity = next(e for e in root.iter("ScenarioObject") if e.get("name") == name)
    ahead = float(entity.find(".//BoundingBox/Center").get("x"))
    group = next(g for g in root.iter("ManeuverGroup") if g.find("Actors/EntityRef").get("entityRef") == name)
    times, places = [], []
    for vertex in group.iter("Vertex"):
        place = vertex.find("Position/WorldPosition")
        x, y, heading = (float(place.get(key)) for key in ("x", "y", "h"))
        times.append(float(vertex.get("time")))
        places.append((x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading))
    return times, places


def box_at(times, places, time):
    """The box at a time: straight lines between vertices, held before the first and after the last."""
    k = min(max(bisect.bisect_right(times, time) - 1, 0), len(times) - 2)
    share = min(max((time - times[k]) / (times[k + 1] - times[k]), 0.0), 1.0)
    return tuple(a + share * (b - a) for a, b in zip(places[k], places[k + 1]))


class Replay(BasicControl):
    """Sets the actor's transform; its physics is switched off, so that nothing pushes it away."""

    def __init__(self, actor, args=None):
        super().__init__(actor)
        self._times, self._places = read_boxes(args["file"], actor.attributes["role_name"])
        self._height = actor.get_transform().location.z
        self._start = None
        actor.set_simulate_physics(False)

    def run_step(self):
        """Called by ScenarioRunner once in each tick."""
        now = self._actor.get_world().get_snapshot().timestamp.elapsed_seconds
        if self._start is None:
            self._start = now - self._times[0]
        x, y, heading = box_at(self._times, self._places, now - self._start)
        # CARLA's y points to the right and its yaw grows clockwise, in degrees; OpenDRIVE's do not.
        place = carla.Location(x=x, y=-y, z=self._height)
        turn = carla.Rotation(pitch=0.0, yaw=-math.degrees(heading), roll=0.0)
        self._actor.set_transform(carla.Transform(place, turn))
        if now - self._start >= self._times[-1]:
            self._reached_goal = True

    def reset(self):
        """Called at the end of the scenario."""
        self._actor = None
