"""Parameters of the guard."""

from __future__ import annotations

from dataclasses import dataclass, fields

from scex_sumo.behaviors.parameters import check_positive


@dataclass(frozen=True, kw_only=True)
class GuardProfile:
    """Parameters of `Guarded`.

    Attributes:
        comfort_deceleration: ``b`` in m/s², what the guard brakes with, and expects of a leader.
        max_deceleration: braking limit in m/s² where less would not do.
        yield_deceleration: hardest braking to give way to one who is not there yet, m/s²; who would have to
            brake harder cannot give way.
        reaction_time: ``tau`` in s; as long as a plan is followed before the next one.
        minimum_gap: kept to whatever is ahead, m, bumper to bumper.
        release_acceleration: regaining the planned speed, m/s².
        margin: of the swept corridor beyond the own width, on each side, m.
        alongside_margin: likewise against vehicles that are alongside now, or come towards the vehicle, m.
        time_margin: between the vehicle and one that crosses its way, s.
        touching: pairs whose boxes are nearer than this in the seed scene are left alone, m: so are recorded
            boxes of who drives side by side, of trailers, and of one vehicle that was tracked twice.
        order_margin: two vehicles that reach a conflict this near to each other go by their numbers, m.
    """

    comfort_deceleration: float = 4.5
    max_deceleration: float = 9.0
    yield_deceleration: float = 5.5
    reaction_time: float = 0.5
    minimum_gap: float = 1.0
    release_acceleration: float = 2.0
    margin: float = 0.3
    alongside_margin: float = 0.1
    time_margin: float = 0.4
    touching: float = 0.0
    order_margin: float = 1.0

    def __post_init__(self) -> None:
        names = [field.name for field in fields(self)]
        positive = [name for name in names if name.endswith("eleration")]
        check_positive(self, *positive)
        check_positive(self, *(name for name in names if name not in positive), zero=True)
