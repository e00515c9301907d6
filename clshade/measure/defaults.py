"""Default amounts of measurement, importable without the modules that measure."""

PIXELS = 4096  # checked by `check`
FRAMES = 15  # per variant of `report`
BENCH_FRAMES = 21  # per workload of `bench`
CREW_FRAMES = 200  # of the turntable of `bench --workers`, for each number of workers
