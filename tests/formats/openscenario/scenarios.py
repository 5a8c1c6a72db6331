"""Scenarios written by hand after the standard's text, on a straight road of two lanes for each direction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.converters.tracks.rows import TrackRows

WIDTH = 3.5
LENGTH = 1000.0


def tag(kind: str, /, *inner: str, **attributes: object) -> str:
    """Element of XML."""
    given = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f"<{kind}{given}>{''.join(inner)}</{kind}>"


def _lane(number: int) -> str:
    return (
        f'<lane id="{number}" type="driving"><width sOffset="0" a="{WIDTH}" b="0" c="0" d="0"/>'
        '<roadMark sOffset="0" type="broken" laneChange="both"/></lane>'
    )


ROAD = f"""<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="7" length="{LENGTH}" junction="-1">
<planView><geometry s="0" x="0" y="0" hdg="0" length="{LENGTH}"><line/></geometry></planView>
<lanes><laneSection s="0"><left>{_lane(2)}{_lane(1)}</left><center><lane id="0" type="none"/></center>
<right>{_lane(-1)}{_lane(-2)}</right></laneSection></lanes></road></OpenDRIVE>"""

BOX = tag(
    "BoundingBox", tag("Center", x=1.4, y=0, z=0.7), tag("Dimensions", length=4.6, width=1.8, height=1.5)
)
CAR = f'<Vehicle name="car" vehicleCategory="car">{BOX}</Vehicle>'
AHEAD = 1.4


def at(lane: int, s: float, offset: float = 0.0) -> str:
    """Position on a lane."""
    return f'<Position><LanePosition roadId="7" laneId="{lane}" s="{s}" offset="{offset}"/></Position>'


def begins(name: str, position: str, speed: float | str, *more: str) -> str:
    """Initial actions of an entity."""
    actions = (f"<TeleportAction>{position}</TeleportAction>", set_speed(speed), *more)
    private = "".join(f"<PrivateAction>{action}</PrivateAction>" for action in actions)
    return f'<Private entityRef="{name}">{private}</Private>'


def set_speed(speed: float | str, shape: str = "step", dimension: str = "time", value: float = 0.0) -> str:
    """Action on the speed; a text is a target with its tag."""
    target = (
        speed if isinstance(speed, str) and speed[:1] == "<" else f'<AbsoluteTargetSpeed value="{speed}"/>'
    )
    return (
        f'<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="{shape}" '
        f'dynamicsDimension="{dimension}" value="{value}"/><SpeedActionTarget>{target}</SpeedActionTarget>'
        "</SpeedAction></LongitudinalAction>"
    )


def change_lane(target: str, shape: str, value: float, dimension: str = "time") -> str:
    """Action of a lane change."""
    return (
        f'<LateralAction><LaneChangeAction><LaneChangeActionDynamics dynamicsShape="{shape}" '
        f'dynamicsDimension="{dimension}" value="{value}"/><LaneChangeTarget>{target}</LaneChangeTarget>'
        "</LaneChangeAction></LateralAction>"
    )


def after(condition: str, edge: str = "none", delay: float = 0.0) -> str:
    """Start trigger of one condition."""
    head = f'<Condition name="c" delay="{delay}" conditionEdge="{edge}">'
    return f"<StartTrigger><ConditionGroup>{head}{condition}</Condition></ConditionGroup></StartTrigger>"


def time(seconds: float | str, rule: str = "greaterOrEqual") -> str:
    """Condition on the time."""
    return f'<ByValueCondition><SimulationTimeCondition value="{seconds}" rule="{rule}"/></ByValueCondition>'


def of(name: str, condition: str) -> str:
    """Condition on an entity."""
    return (
        f'<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{name}"/>'
        f"</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"
    )


def event(name: str, action: str, trigger: str, priority: str = "override") -> str:
    """Event of one private action."""
    return (
        f'<Event name="{name}" priority="{priority}"><Action name="{name} action"><PrivateAction>{action}'
        f"</PrivateAction></Action>{trigger}</Event>"
    )


def story(actor: str, *events: str) -> str:
    """Story in which one actor has some events."""
    return (
        f'<Story name="{actor} story"><Act name="{actor} act"><ManeuverGroup name="{actor} group" '
        f'maximumExecutionCount="1"><Actors selectTriggeringEntities="false"><EntityRef entityRef="{actor}"/>'
        f'</Actors><Maneuver name="{actor} maneuver">{"".join(events)}</Maneuver></ManeuverGroup>'
        f"{after(time(0))}</Act></Story>"
    )


def scenario(
    folder: Path,
    init: str,
    stories: str = "",
    *,
    entities: dict[str, str] | None = None,
    declared: str = "",
    head: str = "",
    stop_s: float = 20.0,
) -> Path:
    """Write a scenario and its road."""
    (folder / "road.xodr").write_text(ROAD)
    objects = "".join(
        f'<ScenarioObject name="{name}">{body}</ScenarioObject>'
        for name, body in (entities or {"Ego": CAR, "Other": CAR}).items()
    )
    stop = after(time(stop_s)).replace("StartTrigger", "StopTrigger")
    file = folder / "case.xosc"
    file.write_text(
        f'<OpenSCENARIO><FileHeader revMajor="1" revMinor="2"/><ParameterDeclarations>{declared}'
        f'</ParameterDeclarations>{head}<RoadNetwork><LogicFile filepath="road.xodr"/></RoadNetwork>'
        f"<Entities>{objects}</Entities><Storyboard><Init><Actions>{init}</Actions></Init>{stories}{stop}"
        "</Storyboard></OpenSCENARIO>"
    )
    return file


def track(file: Path, name: str = "1") -> tuple[TrackRows, tuple[str, ...]]:
    """Rows of one vehicle, and what its reading tells."""
    table, notes = read_recorded([file])
    rows = table.vehicles
    return rows.take(rows.track == rows.labels.index(name)), notes


def axle(rows: TrackRows, time_s: float) -> tuple[float, float, float]:
    """Place of the reference point and speed at a time."""
    k = int(np.argmin(np.abs(rows.timestamp_ms - 1000 * time_s)))
    x, y, heading = (float(v[k]) for v in (rows.x, rows.y, rows.psi_rad))
    speed = float(np.hypot(rows.vx[k], rows.vy[k]))
    return x - AHEAD * np.cos(heading), y - AHEAD * np.sin(heading), speed
