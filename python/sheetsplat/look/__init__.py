"""How data look where nobody chose: transfer functions, colours of isosurfaces, reasons for empty pictures."""
