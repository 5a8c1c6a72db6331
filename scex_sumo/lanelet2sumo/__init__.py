"""Converter from a Road to a SUMO net, and the judge of how faithful a net is."""
