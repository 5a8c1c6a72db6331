"""Traffic that SUMO drives on a net, recorded: synthetic seed scenes.

May import converters, world and all below.
"""
