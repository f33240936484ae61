"""Volumes as few kernels beside SZ3, SPERR and zfp at equal bytes: errors of field, gradient and picture; times."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.measure import Floats, attempt, data_file, rms
from bench.pictures import keep
from bench.report import Goal, Options, Report, Row, columns
from sheetsplat.api import prepare

_VOLUMES = {
    "hydrogen": "hydrogen_64x64x64_float32.nrrd",
    "lcdm": "lcdm_128x128x128_uint8.nrrd",
    "combustion": "turbulent_combustion_128x256x32_uint8.nrrd",
    "mrbrain": "mrbrain_128x128x84_uint8.nrrd",
    "engine": "engine_256x256x128_uint8.nrrd",
}
_RATIOS = (64, 256, 1024)
# Decibels of SZ3 and of a coarse grid of kernels with LZMA at these ratios, measured when the goals were set.
_KNOWN = {
    "hydrogen": ((79.9, 71.8), (56.1, 64.3), (34.2, 57.5)),
    "lcdm": ((46.7, 49.8), (34.4, 38.0), (26.6, 25.7)),
    "combustion": ((47.9, 30.5), (30.9, 24.2), (22.3, 20.6)),
    "mrbrain": ((40.0, 35.1), (27.6, 29.4), (25.5, 26.5)),
    "engine": ((46.6, 38.8), (36.1, 33.3), (28.9, 27.1)),
}
_BETTER = 3.0
ROWS = tuple(f"{name} {ratio}" for name in _VOLUMES for ratio in _RATIOS)

Coder = Callable[[float], tuple[int, Floats]]


def _decibels(values: Floats, other: Floats, span: float) -> float:
    return 20.0 * math.log10(span / max(rms(values - other), 1e-300 * span))


def _of_hdf5(values: NDArray[np.float32], options: Any) -> tuple[int, Floats]:
    """Return the bytes that a filter of HDF5 stores, and what it reads again."""
    import h5py  # type: ignore[import-untyped]

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        stored = file.create_dataset("values", data=values, chunks=values.shape, **options)
        file.flush()
        size = int(stored.id.get_storage_size())
    with h5py.File(stream, "r") as file:
        return size, np.asarray(file["values"][...], np.float64)


def _coders(values: NDArray[np.float32], span: float) -> dict[str, tuple[Coder, float, float]]:
    """Return coders by a number that makes them finer, with its bounds."""
    import hdf5plugin  # type: ignore[import-not-found]
    import pysz  # type: ignore[import-not-found]

    def sz3(digits: float) -> tuple[int, Floats]:
        config = pysz.szConfig(*values.shape)
        config.errorBoundMode = pysz.szErrorBoundMode.ABS
        config.absErrorBound = span * 10.0**-digits
        packed, _ = pysz.sz.compress(values, config)
        return len(packed), np.asarray(pysz.sz.decompress(packed, np.float32, values.shape)[0], np.float64)

    return {
        "sz3": (sz3, 0.0, 6.0),
        # (The filter takes the axes of arrays that are not cubes in the other order.)
        "sperr": (
            lambda quality: _of_hdf5(values, hdf5plugin.Sperr(peak_signal_to_noise_ratio=quality, swap=True)),
            8.0, 130.0,
        ),
        "zfp": (lambda digits: _of_hdf5(values, hdf5plugin.Zfp(accuracy=span * 10.0**-digits)), -1.0, 6.0),
    }  # fmt: skip


def _within(coder: Coder, low: float, high: float, most: float) -> tuple[Floats | None, float]:
    """Return what the finest coding of at most so many bytes reads again, and the seconds of one."""
    best, spent = None, 0.0
    for _ in range(13):
        middle = 0.5 * (low + high)
        begun = time.perf_counter()
        size, found = coder(middle)
        spent = time.perf_counter() - begun
        if size <= most:
            low, best = middle, found
        else:
            high = middle
    return best, spent


def _row(name: str, ratio: int, options: Options) -> Row:
    # Pictures of fields that pass through the samples, as encoded ones nearly do.
    field = ss.open(data_file(options, _VOLUMES[name]), prefilter=True)
    assert isinstance(field, ss.RegularField)
    values = np.asarray(field.values, np.float64)
    low, high = field.value_range
    span, most = high - low, 4 * values.size / ratio
    begun = time.perf_counter()
    encoded = ss.fit.encode(field, bytes=most)
    seconds = time.perf_counter() - begun
    path = options.pictures or None
    assert encoded.bound is not None
    k, j, i = np.indices(values.shape).reshape(3, -1)
    places = np.stack((i, j, k), axis=1) @ field.steps + field.origin
    ours = encoded.at(places).reshape(values.shape)
    prepared = prepare(field, size=options.size, backend="cpu")
    renderer = ss.Renderer("cpu")

    def drawn(one: ss.RegularField | ss.EllipsoidField) -> NDArray[np.float32]:
        image = renderer.render(prepared.scene.replace(field=one), prepared.camera, size=options.size)
        if path is not None:
            keep(options, image, name, str(ratio), type(one).__name__)
        return image.rgba

    whole = drawn(field)
    gradient = np.stack(np.gradient(values))
    steep = float(np.sqrt(np.mean(gradient**2)))
    begun = time.perf_counter()
    renderer.render(prepared.scene.replace(field=encoded), prepared.camera, size=options.size)
    frame = time.perf_counter() - begun
    row: Row = {
        "volume": name,
        "ratio": ratio,
        "bytes": len(encoded.code.data),
        "kernels": encoded.size,
        "db": _decibels(values, ours, span),
        "gradient": rms(np.stack(np.gradient(ours)) - gradient) / steep,
        "picture": rms(drawn(encoded) - whole),
        "seconds": seconds,
        "frame_ms": 1000.0 * frame,
    }
    for coder, (run, coarse, fine) in _coders(values.astype(np.float32), span).items():
        found, spent = _within(run, coarse, fine, most)
        if found is None:
            continue
        row[coder] = _decibels(values, found, span)
        row[f"{coder}_gradient"] = rms(np.stack(np.gradient(found)) - gradient) / steep
        row[f"{coder}_picture"] = rms(drawn(field.replace(found)) - whole)
        row[f"{coder}_seconds"] = spent
    return row


def run(options: Options) -> Report:
    """Encode five volumes at three ratios."""
    rows, goals, better = [], [], 0
    for name in _VOLUMES:
        for number, ratio in enumerate(_RATIOS):
            label = f"{name} {ratio}"
            if not options.wants(label):
                continue
            options.say(label)
            row = attempt(lambda name=name, ratio=ratio: _row(name, ratio, options))  # type: ignore[misc]
            rows.append({"volume": name, "ratio": ratio, **row})
            if "db" in row and ratio > _RATIOS[0]:
                known = max(*_KNOWN[name][number], float(row.get("sz3", 0.0)))
                better += float(row["db"]) >= known + _BETTER
                goals.append(Goal(f"{label}, dB", float(row["db"]), known + _BETTER, least=True))
    shown = columns(
        "volume, ratio, bytes, kernels, db=dB, sz3=SZ3 dB, sperr=SPERR dB, zfp=zfp dB, gradient=gradient error, "
        "sz3_gradient=SZ3, sperr_gradient=SPERR, picture=picture RMSE, sz3_picture=SZ3, sperr_picture=SPERR, "
        "seconds=s, sz3_seconds=SZ3 s, sperr_seconds=SPERR s, frame_ms=frame ms, remark"
    )
    notes = [
        "Ratios are of 4 bytes a sample. Decibels are of the range over the root mean square error at all samples; "
        "errors of gradients over the root mean square of the gradient.",
        "Goals: 3 dB above the better of SZ3, as measured here and as known when the goals were set, and of a coarse "
        "grid of kernels with LZMA.",
    ]
    return Report("encode", "Volumes as few kernels", shown, rows, notes, goals)
