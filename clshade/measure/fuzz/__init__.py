"""Random scenes against the oracle, and damaged files."""
