"""Optional metrics, which are computed if a configuration lists them."""
