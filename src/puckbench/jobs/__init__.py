"""One unit of work each, as the workflow's rules and the command line run it."""
