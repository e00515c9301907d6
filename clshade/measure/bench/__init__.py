"""Speed: workloads, frames a second, workers, and other renderers of the same pictures."""
