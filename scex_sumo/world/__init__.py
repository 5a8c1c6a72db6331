"""Worlds of futures: SUMO (libsumo, sumo-gui) or plain arrays; the only package with libsumo and traci."""
