"""Default amounts of measurement, importable without the modules that measure."""

PIXELS = 4096  # checked by `check`
SAMPLE = 4605  # of verify: if none of so many random pixels is wrong, with 99 % confidence fewer than 0.1 % of all are
FRAMES = 15  # per variant of `report`
BENCH_FRAMES = 21  # per workload of `bench`
BENCH_TURN = 5  # of one renderer in a row, when alternating with another: people draw frame after frame
CREW_FRAMES = 200  # of the turntable of `bench --workers`, for each number of workers
VIEWS = 100  # of `bench --views`
