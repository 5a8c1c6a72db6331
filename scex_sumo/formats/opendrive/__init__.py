"""Reader of OpenDRIVE: reference lines, lanes, their links, signals."""
