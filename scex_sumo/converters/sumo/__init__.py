"""SUMO's own files: nets read as roads, floating car data as tracks, other maps by way of netconvert.

May import the road, formats, tracks and all below; libsumo and the net writer are not known here.
"""
