"""Random rounding: how far images spread when each operation rounds to a random neighbor."""
