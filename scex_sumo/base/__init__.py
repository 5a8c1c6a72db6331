"""Tools that know nothing of traffic: arrays, errors, files, cache, colours, programs, imports by name."""
