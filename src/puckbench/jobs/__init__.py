"""Jobs, run by the rules of the workflow and by the command line."""
