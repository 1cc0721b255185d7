"""Readers of recordings of spinning sensors: packets in captures and bags, turns and returns."""
