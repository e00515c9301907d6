"""Finds, opens and tries OpenCL devices, and keeps what was compiled for them."""
