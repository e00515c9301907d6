"""Speed: frame times of scenes, stage by stage, start-up, and OpenGL's frames of the same image."""
