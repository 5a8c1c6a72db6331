"""Countries with traffic on the left, by code and by place."""

from __future__ import annotations

from scex_sumo.converters.lanelet.origin import Place

_CODES = """
    ag ai au bb bd bm bn bs bt bw ck cy dm fj fk gb gd gg gy hk id ie im in je jm jp ke ki kn ky lc lk ls mo
    ms mt mu mv mw my mz na nf np nr nu nz pg pk pn sb sc sg sh sr sz tc th tk tl to tt tv tz ug vc vg vi ws
    za zm zw AUS GBR HKG IDN IND IRL JPN KEN LKA MYS NZL PAK SGP THA ZAF
"""
CODES = frozenset(_CODES.split())
"""Codes of two letters, as in OpenStreetMap, and of three, as in CommonRoad."""
# South, north, west and east in degrees; near land borders with traffic on the right they leave land out.
_AREAS = (
    *((49.9, 61.0, -11.0, 0.9), (50.88, 53.0, 0.9, 1.45), (51.2, 53.0, 1.45, 1.9)),  # Britain, Ireland
    *((49.1, 49.75, -2.75, -1.98), (35.7, 36.2, 14.1, 14.7), (34.5, 35.8, 32.2, 34.7)),  # islands of Europe
    *((24.0, 28.0, 122.9, 131.5), (30.0, 34.75, 129.0, 132.0)),  # Japan
    *((33.0, 35.5, 130.8, 142.5), (35.5, 41.0, 132.0, 142.5), (41.0, 45.8, 139.0, 146.0)),
    *((5.5, 24.5, 67.0, 88.0), (24.0, 27.9, 75.0, 88.9), (27.9, 30.5, 75.0, 80.9)),  # India, Nepal
    *((20.7, 26.9, 88.0, 92.1), (24.0, 27.5, 89.0, 95.0)),  # Bangladesh, Bhutan
    *((23.5, 29.3, 63.4, 75.0), (29.3, 34.6, 71.2, 77.5)),  # Pakistan
    *((12.5, 18.0, 98.9, 102.0), (14.5, 17.3, 102.0, 104.2), (5.5, 12.5, 98.3, 101.0)),  # Thailand
    *((1.2, 6.7, 100.0, 104.6), (-4.5, 7.4, 108.9, 119.2), (-11.5, 5.5, 95.0, 156.0)),  # Malaysia to Papua
    *((22.15, 22.5, 113.8, 114.45), (22.1, 22.22, 113.52, 113.61)),  # Hong Kong, Macau
    *((-44.0, -10.0, 112.0, 154.0), (-48.0, -34.0, 166.0, 179.0), (-19.5, -16.0, 176.5, 180.0)),  # Australia
    *((-35.0, -18.0, 11.5, 41.0), (-18.0, -13.6, 22.0, 41.0), (-13.6, -1.5, 33.0, 42.0)),  # southern Africa
    *((-8.0, -1.2, 31.0, 33.0), (-1.5, 4.0, 34.2, 41.5), (-1.0, 3.5, 30.2, 34.2)),  # Tanzania, Kenya, Uganda
    *((17.6, 18.6, -78.5, -76.1), (23.3, 27.3, -79.4, -74.0), (13.0, 13.4, -59.7, -59.4)),  # Caribbean
    *((10.0, 11.4, -61.95, -60.4), (4.5, 7.0, -58.6, -54.1), (-20.6, -19.9, 57.2, 57.9)),
)


def drives_left_at(place: Place) -> bool | None:
    """Return whether traffic drives on the left at a latitude and longitude; None at 0, 0: no real place."""
    latitude, longitude = place
    if abs(latitude) < 1.0 and abs(longitude) < 1.0:
        return None
    return any(s <= latitude <= n and w <= longitude <= e for s, n, w, e in _AREAS)
