"""What the thesis's tables and figures need of a plan."""
