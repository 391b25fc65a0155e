"""The parts of the benchmarks: each has ``measure(options)``, which yields `benchmarks.measured.Measured`."""
