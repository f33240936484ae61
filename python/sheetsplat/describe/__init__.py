"""What a scene is, in plain values: as JSON in a PNG, as a TOML file, as Python, and in messages of the viewer's page.

`schema` says which values there are, by the definitions of the options; the other modules write and read them.
"""
