"""Models that come with the package and need no learning: IDM, constant velocity, braking, replay, SUMO's.

May import behaviors.driving and all below.
"""
