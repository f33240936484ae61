"""How data look where no options are given: transfer functions, colours of isosurfaces, reasons for empty pictures."""
