"""Behaviour models, which plan the motion of vehicles."""
