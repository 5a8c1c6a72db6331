"""Worlds that children run in: SUMO through libsumo or sumo-gui, or plain arrays. Only here: libsumo, traci.

May import converters, roads and all below; not behaviors.
"""
