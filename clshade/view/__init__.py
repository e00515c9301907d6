"""What people look at: frames and scenes in a notebook, and a page for images."""
