"""Converters from maps and recordings to roads, SUMO nets and seed scenes."""

if __name__ == "converters":
    raise ImportError("converters/ links to a package below scex_sumo: import scex_sumo.converters")
