"""SUMO's files: nets, floating car data, states, and netconvert's imports."""
