"""Stand-ins for the data of the papers: flows from a solver, and solids filled with kernels."""
