"""Walls, floors and ceilings in recordings of real sensors, and the range noise on them."""
