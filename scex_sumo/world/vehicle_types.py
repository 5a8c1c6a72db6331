"""Vehicle types of SUMO: shapes, sizes, driver parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.converters.tracks.road_users import obstacle_kinds, road_user
from scex_sumo.scene import SeedScene

if TYPE_CHECKING:
    from scex_sumo.base.colors import Rgb

_GUI_SHAPES = {"van": "delivery", "car": "passenger", "tram": "rail/railcar"}
_Driver: TypeAlias = tuple[str, tuple[tuple[str, str], ...], str]  # model, parameters, SUMO's class
PERSON = "_person"
"""End of the name of a person's type."""
WALKER = "_walker"
"""End of the name of the type of a person that SUMO lets walk."""
_TOWARDS_MPS = 0.1  # with which SUMO's drivers expect persons on their lane to come towards them
_CLASSES = {"truck": "truck", "bus": "bus", "motorcycle": "motorcycle"}


def gui_shape(kind: str) -> str:
    """Return SUMO's shape for a recorded type; a passenger car if unknown."""
    user = road_user(kind)
    return _GUI_SHAPES.get(user, user)


def road_class(kind: str) -> str:
    """Return SUMO's class for a recorded type: none for crossings, where vehicles crash libsumo."""
    return _CLASSES.get(gui_shape(kind), "passenger")


def given_type(
    name: str,
    kind: str,
    length: float,
    width: float,
    rgb: Rgb | None = None,
    *,
    own_class: str = "ignoring",
    speed_mps: float = 200.0,
) -> str:
    """Return the ``vType`` of moved vehicles; class ``ignoring`` may be on any lane."""
    attributes = {"vClass": own_class, "guiShape": gui_shape(kind), "maxSpeed": f"{speed_mps:g}"}
    if rgb is not None:
        attributes["color"] = ",".join(str(c) for c in rgb)
    return _element(name, length, width, attributes)


def _driven_type(
    name: str, kind: str, length: float, width: float, model: str, parameters: Mapping[str, str], own: str
) -> str:
    from scex_sumo.base.sumo.car_following import RANDOM_PARAMETERS

    attributes = {"vClass": own or road_class(kind), "guiShape": gui_shape(kind), "carFollowModel": model}
    return _element(name, length, width, attributes | dict.fromkeys(RANDOM_PARAMETERS, "0") | {**parameters})


def _element(name: str, length: float, width: float, attributes: Mapping[str, str]) -> str:
    fixed = {"id": name, "length": repr(float(length)), "width": repr(float(width)), "speedFactor": "1"}
    every = {**fixed, "speedDev": "0", **attributes}
    return "<vType" + "".join(f" {key}={quoted(value)}" for key, value in every.items()) + "/>\n"


class TypeBook:
    """Vehicle types of a seed scene: one for each type and size, and for each SUMO driver.

    Attributes:
        random: whether a driver uses SUMO's random numbers.
    """

    def __init__(self, scene: SeedScene) -> None:
        """Collect types and sizes of all road users."""
        self._scene, self.random = scene, False
        self._vehicles = list(zip(scene.types, scene.length.tolist(), scene.width.tolist(), strict=True))
        self._obstacles = []
        if (others := scene.obstacles) is not None:
            columns = obstacle_kinds(others), others.length.tolist(), others.width.tolist()
            self._obstacles = list(zip(*columns, strict=True))
        self._drivers: dict[_Driver, int] = {}
        self._written: set[int] = set()

    @property
    def complete(self) -> bool:
        """Whether the last file has every driver."""
        return self._written == set(self._drivers.values())

    def enter(self, vehicle: int, model: str, parameters: Mapping[str, str]) -> None:
        """Enter a SUMO driver; raises a `UsageError` as `check_driver`."""
        from scex_sumo.base.sumo.car_following import RANDOM_MODELS, check_driver

        key = self._driver(vehicle, model, parameters)
        if key not in self._drivers:
            check_driver(model, parameters)
            self.random |= model in RANDOM_MODELS
            self._drivers[key] = len(self._drivers)

    def _driver(self, vehicle: int, model: str, parameters: Mapping[str, str]) -> _Driver:
        intention = self._scene.intention(vehicle)
        own = "" if intention is None else intention.vehicle_class
        return model, tuple(sorted(parameters.items())), own

    def overridden(self, vehicle: int) -> str:
        """Return the type of a moved vehicle."""
        return _type_name(*self._vehicles[vehicle])

    def driven(self, vehicle: int, model: str, parameters: Mapping[str, str]) -> str:
        """Return the type of a SUMO-driven vehicle."""
        index = self._drivers[self._driver(vehicle, model, parameters)]
        return f"{self.overridden(vehicle)}_{model}{index}"

    def obstacle(self, obstacle: int) -> str:
        """Return the type of a pedestrian or cyclist."""
        return _type_name(*self._obstacles[obstacle])

    def write(self, path: Path) -> None:
        """Write SUMO's additional file."""
        lines = {}
        colored: list[tuple[tuple[str, float, float], Rgb | None]] = [(size, None) for size in self._vehicles]
        if self._obstacles:
            from scex_sumo.base.colors import OTHER_RGB

            colored += [(size, OTHER_RGB) for size in self._obstacles]
        for size, rgb in colored:
            name = _type_name(*size)
            lines[name] = given_type(name, *size, rgb)
            if road_user(size[0]) == "pedestrian":
                towards: dict[str, Any] = {"own_class": "passenger", "speed_mps": _TOWARDS_MPS}
                lines[name + PERSON] = given_type(name + PERSON, *size, rgb, **towards)
                lines[name + WALKER] = given_type(name + WALKER, *size, rgb, own_class="pedestrian")
        for (model, parameters, own), index in self._drivers.items():
            for size in self._vehicles:
                name = f"{_type_name(*size)}_{model}{index}"
                lines[name] = _driven_type(name, *size, model, dict(parameters), own)
        path.write_text(f"<additional>\n{''.join(lines.values())}</additional>\n", encoding="utf-8")
        self._written = set(self._drivers.values())


def _type_name(kind: str, length: float, width: float) -> str:
    return f"{re.sub('[^a-z0-9]', '_', kind)}_{length!r}x{width!r}"
