"""Models without learning: IDM, constant velocity, braking, replay, SUMO's."""
