"""Converters from maps and recordings to roads, SUMO nets and seed scenes."""
