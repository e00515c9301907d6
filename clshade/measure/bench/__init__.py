"""Speed: frame times of scenes, stage by stage, and OpenGL's frames of the same image."""
