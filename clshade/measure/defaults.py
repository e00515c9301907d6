"""How much is measured unless it is said, for those who name it before they load what measures."""

PIXELS = 4096  # that `check` computes again
FRAMES = 15  # of each variant that `report` draws
BENCH_FRAMES = 21  # of each workload that `bench` draws
CREW_FRAMES = 200  # of a turntable that `bench --workers` draws with each number of workers
