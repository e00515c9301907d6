"""Finds, tests and opens OpenCL devices, and keeps what was compiled for them."""
