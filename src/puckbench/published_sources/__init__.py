"""Numbers that others published, with the conditions under which they hold."""
