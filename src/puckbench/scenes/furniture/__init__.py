"""Furniture: each function makes an item that stands on z = 0, its front to -y, its back to +y."""
