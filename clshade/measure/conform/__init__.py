"""`python -m clshade conform`: whether an OpenCL device computes what it has to."""
