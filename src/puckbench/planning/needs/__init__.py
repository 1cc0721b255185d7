"""What tables and figures need of a plan."""
