"""Results of a run: what their columns contain, and the tables that join them."""
