"""CommonRoad scenarios: maps and recorded road users. Only here: commonroad-io.

May import roads, geometry, converters.cleaning, converters.tracks.
"""
