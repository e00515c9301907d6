"""Images that anyone can audit: random pixels of a file computed again in float64, without OpenCL."""
