"""OpenSCENARIO XML: the motion that a scenario itself defines, as a recording."""
