"""Tables from the files of many jobs, and the summary of results."""
