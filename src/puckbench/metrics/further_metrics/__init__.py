"""Optional metrics, computed if a configuration lists them."""
