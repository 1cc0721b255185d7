"""Models of furniture; each function makes an item on z = 0, with its front towards -y."""
