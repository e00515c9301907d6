"""Default amounts of measurement, importable without the modules that measure."""

PIXELS = 4096  # checked by `check`
SAMPLE = 4605  # of verify: if none of so many random pixels is wrong, with 99 % confidence fewer than 0.1 % of all are
FRAMES = 15  # per variant of `report`
BENCH_FRAMES = 21  # per scene of `bench`
