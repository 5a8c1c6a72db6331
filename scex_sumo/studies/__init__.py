"""Studies of many runs: rank, validate, compare, explain, and the sample size. A wing around the core."""
