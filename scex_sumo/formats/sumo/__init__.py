"""SUMO's own files: nets as maps, floating car data and states as tracks, netconvert's imports."""
