"""Generated seed scenes: SUMO's demand, and scenes as recorded ones look."""
