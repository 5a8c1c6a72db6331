"""Studies of many moments: rank and validate; inspection of a recording; a driving function under test."""
