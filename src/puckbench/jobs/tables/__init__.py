"""Tables gathered from the files of many jobs, and their summary."""
