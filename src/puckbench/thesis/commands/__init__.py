"""Commands of the thesis."""
