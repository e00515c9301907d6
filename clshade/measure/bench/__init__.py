"""Speed: workloads, frame times, workers, and other renderers of the same images."""
