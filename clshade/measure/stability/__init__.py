"""Stiff and extreme cases, and curves towards them."""
