"""What people look at: how scenes and frames show themselves in a notebook."""
