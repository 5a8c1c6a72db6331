"""Views of futures in plain sumo-gui."""
