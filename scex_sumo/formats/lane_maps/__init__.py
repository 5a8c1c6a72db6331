"""Maps of lane polylines, for formats that draw lanes without Lanelet2's relations."""
