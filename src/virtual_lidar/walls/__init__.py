"""Detection of walls, floors and ceilings in recordings, and statistics of range errors on them."""
