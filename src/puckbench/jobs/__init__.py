"""Jobs that the workflow's rules and the command line run."""
