"""Scene -> Frame on OpenCL."""
