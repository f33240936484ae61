"""Installs a wheel with each extra alone into a new virtual environment, and tries what the extra promises.

    python packaging/try_extras.py dist/sheetsplat-0.1.0-….whl [EXTRA ...]

Prints a table: what was tried, whether it worked, and the seconds of a processor that the import of the package and
`sheetsplat --help` took, the least of five. Needs a package index for what the extras bring; the environments are
removed again. "none" is the wheel without any extra.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_HEAD = """
import sys, warnings, importlib.util
import numpy as np, sheetsplat as ss
n = np.linspace(-1, 1, 16)
values = np.exp(-4 * (n[:, None, None] ** 2 + n[:, None] ** 2 + n**2)).astype(np.float32)
def drawn(image):
    assert image.size == (32, 32) and float(np.asarray(image)[..., 3].max()) > 0.05
    return image
def there(name):
    return importlib.util.find_spec(name) is not None
def picture(data, **options):
    return drawn(ss.render(data, size=32, backend="cpu", **options))
"""
# What each extra promises, as docs/installation.md has it.
PROMISES = {
    "none": """
picture(values).save("x.png")
for name in ("matplotlib", "xarray", "vtk", "aiohttp", "anywidget", "imageio_ffmpeg", "distributed"):
    assert not there(name), name
for call, extra in ((lambda: picture(values).annotated(), "plot"), (lambda: ss.view(values, browser=False).url, "view"),
                    (lambda: ss.turntable(values, frames=2, size=16, backend="cpu").save("x.mp4"), "video")):
    try:
        call()
        raise SystemExit(f"{extra}: no error")
    except ss.Error as error:
        assert f"sheetsplat[{extra}]" in str(error), error
""",
    "plot": """
picture(values).annotated(title="a").save("figure.png")
""",
    "video": """
film = ss.turntable(values, frames=3, size=32, backend="cpu")
for name in ("x.mp4", "x.webm", "x.gif"):
    film.save(name)
""",
    "medical": """
import nibabel
nibabel.save(nibabel.Nifti1Image(values, np.diag([1.0, 2, 3, 1])), "a.nii.gz")
picture("a.nii.gz")
import pydicom
""",
    "science": """
import xarray, zarr, tifffile, mrcfile, meshio, dask.array
data = xarray.DataArray(values, dims=("z", "y", "x"), name="t")
data.to_netcdf("a.nc", engine="h5netcdf")
zarr.create_array("a.zarr", data=values)
tifffile.imwrite("a.tif", values)
with mrcfile.new("a.mrc") as file:
    file.set_data(values)
points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0), (1, 1, 1.0)]
meshio.write("a.msh", meshio.Mesh(points, [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])], point_data={"a": np.arange(5.0)}),
             file_format="gmsh")
for one in (data, dask.array.from_array(values), "a.nc", "a.zarr", "a.tif", "a.mrc"):
    picture(one)
ss.open("a.msh")
""",
    "pyvista": """
import pyvista, sheetsplat.integrations.pyvista as ours
grid = pyvista.ImageData(dimensions=(16, 16, 16), spacing=(0.1, 0.1, 0.1))
grid["a"] = values.ravel()
drawn(grid.sheetsplat.render(size=32, backend="cpu"))
plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32))
plotter.add_mesh(pyvista.Plane(center=(0.7, 0.7, 0.7)))
image = drawn(ours.composite(plotter, grid, backend="cpu"))
assert np.isfinite(image.depth_limit).any()
""",
    "jupyter": """
viewer = ss.view(values, browser=False, backend="cpu")
assert viewer.widget.height == 520
viewer.close()
""",
    "view": """
import urllib.request
with ss.view(values, browser=False, backend="cpu") as viewer:
    page = urllib.request.urlopen(viewer.url).read()
    assert b"viewer.js" in page
""",
    "distributed": """
from distributed import Client
if __name__ == "__main__":
    with Client(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as client:
        film = ss.turntable(values, frames=3, size=32, backend="cpu")
        film.save("there", client=client)
        film.save("here")
    from pathlib import Path
    for n in range(3):
        assert Path(f"there/frame_{n:04}.png").read_bytes() == Path(f"here/frame_{n:04}.png").read_bytes()
""",
    "parquet": """
import pyarrow, pyarrow.parquet
rng = np.random.default_rng(1)
table = {name: rng.random(200) for name in ("x", "y", "z", "value")} | {"radius": np.full(200, 0.1)}
pyarrow.parquet.write_table(pyarrow.table(table), "a.parquet")
picture(ss.open_bricks("a.parquet"))
""",
    "osmesa": """
import os
os.environ["SHEETSPLAT_GL"] = "osmesa"
image = drawn(ss.render(values, size=32, backend="gl"))
assert image.plan.backend == "gl"
print(image.plan.device)
""",
}
# All that the extra "all" brings.
PROMISES["all"] = "\n".join(text for name, text in PROMISES.items() if name not in ("none", "osmesa"))
_IMPORT = "import time; a = time.process_time(); import sheetsplat; print(time.process_time() - a)"


def attempt(wheel: Path, extra: str) -> tuple[bool, str, float, float]:
    """Return whether an extra keeps its promise, what was said, and the seconds of an import and of the help."""
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "venv" / "bin" / "python"
        subprocess.run([sys.executable, "-m", "venv", Path(folder) / "venv"], check=True)
        wanted = f"{wheel.resolve()}" + ("" if extra == "none" else f"[{extra}]")
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--prefer-binary", wanted]
        done = subprocess.run(pip, capture_output=True, text=True)
        if done.returncode:
            return False, "pip: " + done.stderr.strip()[-300:], 0.0, 0.0
        script = Path(folder) / "try.py"
        script.write_text(_HEAD + PROMISES[extra], encoding="utf-8")
        # No build tools, and nothing of the environment that runs this.
        environment = {"PATH": f"{python.parent}:/usr/bin:/bin", "HOME": folder, "MPLBACKEND": "agg"}
        run = {"cwd": folder, "env": environment, "capture_output": True, "text": True}
        done = subprocess.run([python, "-W", "error::UserWarning:sheetsplat", script], **run)  # type: ignore[call-overload]
        imports, helps = [], []
        for _ in range(5):
            told = subprocess.run([python, "-c", _IMPORT], **run)  # type: ignore[call-overload]
            imports.append(float(told.stdout))
            before = _of_children()
            subprocess.run([python.parent / "sheetsplat", "--help"], check=True, **run)  # type: ignore[call-overload]
            helps.append(_of_children() - before)
        text = (done.stdout if done.returncode == 0 else done.stderr).strip()
        return done.returncode == 0, (text.splitlines() or [""])[-1], min(imports), min(helps)


def _of_children() -> float:
    """Return the seconds of a processor that ended child processes have taken."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Try the extras that are named, or all."""
    wheel, names = Path(sys.argv[1]), sys.argv[2:] or list(PROMISES)
    print("extra        works  import [s]  --help [s]  seconds", flush=True)
    failed = False
    for name in names:
        began = time.monotonic()
        good, text, imported, helped = attempt(wheel, name)
        failed = failed or not good
        took = time.monotonic() - began
        print(
            f"{name:<12} {'yes' if good else 'NO':<6} {imported:<11.3f} {helped:<11.3f} {took:<8.0f} {text}", flush=True
        )
    sys.exit(failed)


if __name__ == "__main__":
    os.environ.pop("PYTHONPATH", None)
    main()
