"""What ccpin costs beside its peers, every figure a ratio taken in one process: ``python -m benchmarks``."""
