"""Detection of walls, floors and ceilings in recordings, and analysis of range noise on them."""
