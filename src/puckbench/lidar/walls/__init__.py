"""Walls, floors and ceilings in a recording of a real sensor, and the range noise on them."""
