"""Tables made from the results of a run."""
