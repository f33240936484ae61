"""What a quality measures of the data: their samples, their slices, and kernels too small for pixels or slices."""
