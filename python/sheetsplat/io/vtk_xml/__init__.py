"""VTK's XML files: meshes (.vtu), structured grids (.vts), surfaces (.vtp), images (.vti, .vtr), and blocks (.vtm).

`document` parses the XML, `arrays` finds and decodes arrays, `meshes` and `images` read files,
`extents` joins pieces of structured ones, `blocks` finds what a .vtm names.
Hand-written, because meshio unpacks blocks without a bound, and the vtk package is a dependency of 100 MB.
Source: the VTK File Formats document, "XML File Formats".
"""
