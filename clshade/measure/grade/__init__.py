"""What is wrong with a course's image: the mistake that explains the difference from the right one, named."""
