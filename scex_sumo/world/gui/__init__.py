"""What sumo-gui shows: drawings over the map, names of vehicles, settings of the view.

Imports the frame and colours of the world, nothing of SUMO.
"""
