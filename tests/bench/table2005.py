"""Table 1 of Neophytou & Mueller 2005: fifteen data sets, with the paper's splats and frames a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.generators import flows
from bench.measure import Judge, data_file, device_of, frames_and_error, measured_rows, orbit, renderer_for
from bench.report import Options, Report, Row, columns, environment
from sheetsplat import datasets
from sheetsplat.bcc import resample_to_bcc
from sheetsplat.io import read_volume

Values = NDArray[Any]
Loaded = tuple[Values, tuple[float, float, float], str]
Color = tuple[float, float, float]


@dataclass(frozen=True)
class Picture:
    """A row: how its samples are loaded and drawn, and what the paper reports for it."""

    load: Callable[[Options], Loaded]
    paper_size: str
    paper_samples: int
    paper_splats: int
    paper_fps: float
    colors: tuple[Color, Color] = ((0.75, 0.35, 0.2), (1.0, 0.95, 0.85))
    opacity: float = 0.3
    isosurface: bool = False
    # Name of the row whose volume is shown here on the BCC lattice, with that row's threshold.
    bcc_of: str = ""

    @property
    def share(self) -> float:
        """Share of its samples that the paper drew."""
        return self.paper_splats / self.paper_samples


def _generated(make: Callable[[Options], datasets.Dataset]) -> Callable[[Options], Loaded]:
    def loaded(options: Options) -> Loaded:
        made = make(options)
        return made.values, made.spacing, f"generated {made.name} (stand-in)"

    return loaded


def _file(name: str, source: str) -> Callable[[Options], Loaded]:
    def loaded(options: Options) -> Loaded:
        volume = read_volume(data_file(options, name))
        return volume.values, volume.spacing, source

    return loaded


def _foot(options: Options) -> Loaded:
    """Return the Visible Male's head, halved along y and z to 128^3, the size of the paper's foot."""
    values, spacing, _ = _file("vismale_128x256x256_uint8.nrrd", "")(options)
    nk, nj, ni = values.shape
    blocks = values[: nk - nk % 2, : nj - nj % 2].reshape(nk // 2, 2, nj // 2, 2, ni)
    half = np.floor(blocks.mean(axis=(1, 3), dtype=np.float32) + 0.5).astype(values.dtype)
    return half, (spacing[0], 2.0 * spacing[1], 2.0 * spacing[2]), "Visible Male, halved (stand-in)"


_vortex = _generated(lambda options: flows.vortex(options.edge(128, 32)))
_turbulence = _generated(
    lambda options: flows.turbulence((options.edge(129, 33), options.edge(129, 33), options.edge(104, 26)))
)
_jet = _generated(lambda options: flows.jet(options.edge(256, 32)))
_bonsai = _file("bonsai_256x256x256_uint8.nrrd", "bonsai")
_head = _file("cthead_128x128x113_uint8.nrrd", "CT head, 113 slices")
_engine = _file("engine_256x256x128_uint8.nrrd", "engine")
_lobster = _file("lobster_120x120x34_uint8.nrrd", "lobster, the reduced scan")
_aneurism = _file("aneurism_128x128x128_uint8.nrrd", "aneurism")

_BLUE: tuple[Color, Color] = ((0.15, 0.35, 0.95), (1.0, 0.85, 0.3))
_FIRE: tuple[Color, Color] = ((0.9, 0.3, 0.1), (1.0, 0.95, 0.7))
_TREE: tuple[Color, Color] = ((0.3, 0.65, 0.2), (0.65, 0.4, 0.2))
_METAL: tuple[Color, Color] = ((0.35, 0.4, 0.5), (1.0, 0.75, 0.35))
_BONE: tuple[Color, Color] = ((0.85, 0.5, 0.35), (1.0, 0.95, 0.85))

PICTURES = {
    "Vortex": Picture(_vortex, "128^3", 128**3, 479_000, 5.2, _BLUE),
    "Jet simul.": Picture(_jet, "256^3", 256**3, 648_000, 4.0, _BLUE),
    "Turbulence": Picture(_turbulence, "104x129^2", 104 * 129**2, 95_000, 6.1, _FIRE),
    "Foot Isosurf.": Picture(_foot, "128^3", 128**3, 191_000, 7.2, _BONE, isosurface=True),
    "Foot semiTran.": Picture(_foot, "128^3", 128**3, 184_000, 6.4, _BONE, opacity=0.1),
    "Foot semi-2": Picture(_foot, "128^3", 128**3, 181_000, 7.6, _BONE, opacity=0.6),
    "Lobster": Picture(_lobster, "320^2x34", 320**2 * 34, 219_000, 10.2, _FIRE),
    "Aneurism": Picture(_aneurism, "128^3", 128**3, 17_000, 9.1, _FIRE, opacity=0.7),
    "Bonsai": Picture(_bonsai, "256^3", 256**3, 1_300_000, 4.9, _TREE),
    "BonsaiBCC": Picture(_bonsai, "181^2x362", 181**2 * 362, 955_000, 2.5, _TREE, bcc_of="Bonsai"),
    "CT Head semi": Picture(_head, "128^3", 128**3, 526_000, 4.9, _BONE, opacity=0.15),
    "CT Head BCC": Picture(_head, "91^2x182", 91**2 * 182, 379_000, 3.1, _BONE, opacity=0.15, bcc_of="CT Head semi"),
    "Engine Semi": Picture(_engine, "256^2x128", 256**2 * 128, 1_200_000, 2.1, _METAL, opacity=0.1),
    "Engine ISO": Picture(_engine, "256^2x128", 256**2 * 128, 1_300_000, 5.1, _METAL, isosurface=True),
    "Engine BCC": Picture(
        _engine, "181^2x182", 181**2 * 182, 963_000, 5.3, _METAL, isosurface=True, bcc_of="Engine ISO"
    ),
}

#: Names of the rows.
ROWS = tuple(PICTURES)


def threshold_for(values: Values, share: float) -> float:
    """Return a value that about this share of the samples exceeds; for whole numbers half-way between two of them."""
    if values.dtype.kind in "iu":
        lowest = int(values.min())
        counts = np.bincount((values.astype(np.int64) - lowest).ravel())
        above = values.size - np.cumsum(counts)
        return lowest + int(np.argmin(np.abs(above - share * values.size))) + 0.5
    return float(np.quantile(values, 1.0 - share))


def _scene(picture: Picture, field: ss.RegularField, threshold: float, top: float, length: float) -> ss.Scene:
    """Return the row's scene; `length`: reference length, the spacing of the Cartesian samples for both lattices."""
    first, last = picture.colors
    light = ss.Light((0.3, 0.5, 1.0))
    material = ss.Material(specular=0.3)
    if picture.isosurface:
        points = [(threshold, *last, 1.0)]
        return ss.Scene(field, points, mode="isosurface", iso_value=threshold, lights=[light], material=material)
    middle = 0.5 * (threshold + top)
    points = [(threshold, *first, 0.0), (middle, *first, 0.4 * picture.opacity), (top, *last, picture.opacity)]
    return ss.Scene(field, points, lights=[light], material=material, reference_length=length)


def run(options: Options) -> Report:
    """Draw and judge every row that is wanted."""
    options = options.preferring("gl")
    renderer = renderer_for(options)
    judge = Judge(options.size, options.reference_seconds)

    def measure(name: str, picture: Picture) -> Row:
        values, spacing, source = picture.load(options)
        share = PICTURES[picture.bcc_of].share if picture.bcc_of else picture.share
        threshold, top = threshold_for(values, share), float(values.max())
        bcc = bool(picture.bcc_of)
        field = resample_to_bcc(values, spacing).field() if bcc else ss.RegularField(values, spacing=spacing)
        # As in the paper: nothing beyond the samples.
        field = field.replace(boundary="zero", base=0.0)
        nk, nj, ni = field.shape
        scene = _scene(picture, field, threshold, top, min(spacing))
        row, _, _ = frames_and_error(options, judge, renderer, scene, orbit(field, options.views), name)
        above = int(np.count_nonzero(field.values > threshold))
        return {"source": source, "size": f"{ni}x{nj}x{nk}", "above": above, "threshold": threshold, **row}

    rows = measured_rows(options, PICTURES, measure)
    for row in rows:
        picture = PICTURES[row["row"]]
        row |= {name: getattr(picture, name) for name in ("paper_size", "paper_splats", "paper_fps")}
    return Report(
        name="table2005",
        title=f"Table 1 of Neophytou & Mueller 2005, at {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=data set, source=shown by, size=size x y z, above, threshold, kernels_drawn, slices, wall_ms, cpu_ms, "
            "fps, rmse, p99_9, maximum, error_size, paper_size=paper: size, paper_splats=paper: splats, "
            "paper_fps=paper: fps, remark"
        ),
        rows=rows,
        notes=[
            options.views_note,
            "above: samples above the threshold, which is chosen so that their share equals the paper's share of drawn "
            "splats. drawn: kernels that can contribute, including the neighbours of visible ones.",
            options.error_note,
            "The paper: Pentium 4 at 3 GHz, Quadro FX 3400 (GeForce 6800 GT), 400x400. Its foot, vortex, jet and "
            "turbulence data are not available; the column 'shown by' names the stand-ins.",
        ],
        environment=environment(device_of(renderer)),
    )
