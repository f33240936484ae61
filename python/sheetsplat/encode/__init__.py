"""Fields of few kernels that stand for many samples."""
