"""What every room stands on: errors, random streams, whole files, threads, compiled loops."""
