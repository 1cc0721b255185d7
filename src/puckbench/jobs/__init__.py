"""Jobs: one unit of work each, run by the rules of the workflow and by the command line."""
