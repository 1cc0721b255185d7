"""The thesis: its claims, its published numbers, its residual study and its figures."""
