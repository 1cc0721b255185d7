"""Tables made of the table of all results."""
