"""xarray: a field of the atmosphere.

A DataArray brings its dimensions, coordinates, name and units: they become axes, spacing and labels. Longitude,
latitude and height are recognised in any order.
"""

import numpy as np
import xarray as xr

import sheetsplat as ss
import sheetsplat.integrations.xarray  # noqa: F401  registers the accessor

SIZE = (520, 400)

# Wind speed of a jet stream that meanders around 45° north, with a maximum at 11 km.
height = xr.DataArray(np.linspace(0, 20, 41), dims="height", attrs={"units": "km", "axis": "Z"})
latitude = xr.DataArray(np.linspace(20, 70, 51), dims="lat", attrs={"units": "degrees_north"})
longitude = xr.DataArray(np.linspace(0, 90, 91), dims="lon", attrs={"units": "degrees_east"})
middle = 45 + 8 * np.sin(np.deg2rad(6 * longitude))
core = 55 * (1 + 0.35 * np.cos(np.deg2rad(6 * longitude + 40)))
wind = core * np.exp(-(((latitude - middle) / 6) ** 2) - ((height - 11) / 3.5) ** 2) + 0.6 * height
wind = wind.transpose("lat", "lon", "height").assign_coords(height=height, lat=latitude, lon=longitude)
wind = wind.rename("u").assign_attrs(long_name="wind speed", units="m/s")

# One degree is drawn as long as one kilometre; `spacing` sets the length of a step along each axis.
image = wind.sheetsplat.render(
    spacing=(1, 1, 1), cmap="magma", clim=(10, 75), opacity=[(10, 0), (25, 0.01), (75, 0.3)], azimuth=-60, size=SIZE
)
image.annotated(title="Jet stream").save("xarray_climate.png")
print(wind.sheetsplat.field(spacing=(1, 1, 1)))
assert ss.open(wind, spacing=(1, 1, 1)) == wind.sheetsplat.field(spacing=(1, 1, 1))
