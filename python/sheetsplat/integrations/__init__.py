"""Accessors for data of other libraries; each module registers its own when it is imported.

>>> import sheetsplat.integrations.xarray
>>> data_array.sheetsplat.render().save("picture.png")
"""
