"""Behaviour models, which plan the motion of vehicles."""

if __name__ == "behaviors":
    raise ImportError("behaviors/ links to a package below scex_sumo: import scex_sumo.behaviors")
