"""Error against run time: variants, their figure, and settings chosen from them."""
