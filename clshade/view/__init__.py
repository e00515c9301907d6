"""What people look at: frames and scenes in a notebook, films."""
