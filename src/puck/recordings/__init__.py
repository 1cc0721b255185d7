"""Recordings of spinning sensors: packets in captures and bags, the turns and returns in them."""
