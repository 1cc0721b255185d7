"""Models of furniture on z = 0, facing -y."""
