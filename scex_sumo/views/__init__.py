"""Views of children in plain sumo-gui."""
