"""Views of frames and scenes in a notebook."""
