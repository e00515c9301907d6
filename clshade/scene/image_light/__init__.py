"""What shading with an environment needs of it, computed once per environment."""
