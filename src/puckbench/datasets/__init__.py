"""Scene sets: generated scenes and data sets on disk, one file per set."""
