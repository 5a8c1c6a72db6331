"""Tables of a result folder: states, plans, outcomes, encounters, origins of extrema."""
