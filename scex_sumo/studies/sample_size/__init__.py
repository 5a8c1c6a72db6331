"""Sample size: how many futures a map needs, and its page."""
