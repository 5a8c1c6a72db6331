"""Table of places in the terminal."""

from scex_sumo.studies.validate.command import _ratio


def test_standing_vehicles_have_no_ratio_to_constant_velocity() -> None:
    rows = [{"error_of_mean_m": 0.5, "constant_velocity_error_m": error} for error in (1.0, 0.0)]
    assert [_ratio(row) for row in rows] == [0.5, None]
