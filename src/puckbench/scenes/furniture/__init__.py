"""Furniture: each function makes an item that stands on z = 0, with its front towards -y."""
