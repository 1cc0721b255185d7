"""What recordings and scans are stored in today, each by a well-kept library: the baselines."""
