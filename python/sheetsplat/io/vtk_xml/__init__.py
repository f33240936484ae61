"""VTK's XML files: unstructured meshes (.vtu), surfaces (.vtp) and images (.vti).

`document` parses the XML, `arrays` finds and decodes arrays, `meshes` and `images` read files.
Hand-written, because meshio unpacks blocks without a bound, and the vtk package is a dependency of 100 MB.
Source: the VTK File Formats document, "XML File Formats".
"""
