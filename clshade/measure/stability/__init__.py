"""Stiff and extreme cases, and error curves towards them."""
