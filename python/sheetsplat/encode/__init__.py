"""Fields of few kernels, and their bytes."""
