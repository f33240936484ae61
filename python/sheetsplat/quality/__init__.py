"""What `quality` sets: kernels and their coefficients (`samples`), slices and the filter (`choose`)."""
