"""Error messages: parts that many of them share."""

from __future__ import annotations

from scex_sumo.base.errors import nearest


def test_the_three_nearest_names_are_named_the_nearest_first() -> None:
    names = ["standard_driver", "risky_driver", "constant_velocity", "sumo:EIDM", "sumo:IDM"]
    assert nearest("risk_driver", names) == "risky_driver, standard_driver, constant_velocity"
    assert nearest("SUMO:eidm", names).startswith("sumo:EIDM, sumo:IDM, ")
