"""Criticality metrics: nanoscopic values per pair, microscopic values per future."""

if __name__ == "metrics":
    raise ImportError("metrics/ links to a package below scex_sumo: import scex_sumo.metrics")
