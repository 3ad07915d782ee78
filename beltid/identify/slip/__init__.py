"""Speed-loss recordings: the sliding speeds of a belt in service, Eq. (7)."""
