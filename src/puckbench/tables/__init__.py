"""Tables computed from results, and how tables are written."""
