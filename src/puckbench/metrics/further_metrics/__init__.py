"""Optional metrics, which a configuration names."""
