"""Reading and writing of pictures."""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import stat
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Error, complain, missing_package
from sheetsplat.io.numpy_files import read_array
from sheetsplat.io.png_text import KEYWORD
from sheetsplat.io.source import Source, guarded

Floats = NDArray[np.float32]
# Formats that keep float32, and those that Pillow writes, with its options.
FLOATS = (".exr", ".npy")
_RASTERS: dict[str, tuple[str, dict[str, Any]]] = {
    ".png": ("PNG", {}),
    ".jpg": ("JPEG", {"quality": 95}),
    ".jpeg": ("JPEG", {"quality": 95}),
    ".tif": ("TIFF", {"compression": "tiff_adobe_deflate"}),
    ".tiff": ("TIFF", {"compression": "tiff_adobe_deflate"}),
    ".webp": ("WEBP", {"lossless": True, "exact": True}),
}
#: Of pictures of numbers.
FITS = ".fits"
#: Of figures, whose text stays text, and of all figures.
VECTORS = (".pdf", ".svg")
FIGURES = (*_RASTERS, *VECTORS)
#: Suffixes of pictures.
SUFFIXES = (*_RASTERS, *FLOATS, FITS)
#: Suffixes of further outputs and of differences.
CHANNEL_SUFFIXES = (".png", *FLOATS)


def listed_suffixes(known: Sequence[str] = SUFFIXES) -> str:
    """Return ".png, .exr or .npy"."""
    return f"{', '.join(known[:-1])} or {known[-1]}"


def check_suffix(path: Path, known: Sequence[str] = SUFFIXES) -> str:
    """Return the suffix in small letters, or InvalidInput where it is not a known one."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise complain(f"{path} cannot be written", f"the suffix {suffix!r}", "one of: " + ", ".join(known))
    return suffix


def check_folder(path: Path) -> None:
    """Raise Error where the folder of `path` does not exist or cannot be written to."""
    folder = path.resolve().parent
    failed = f"{path} cannot be written"
    if not folder.is_dir():
        raise complain(failed, f"no folder {folder}", "a path in an existing folder", kind=Error)
    if not os.access(folder, os.W_OK):
        raise complain(failed, f"no right to write to {folder}", "another folder", kind=Error)


# Temporary files of `whole_file` that are being written.
_unfinished: set[Path] = set()


def _target(path: Path) -> Path:
    """Return where `path` leads through symbolic links; Error where that is neither a regular file nor a new one."""
    try:
        kind = path.stat().st_mode
    except FileNotFoundError:
        kind = stat.S_IFREG
    if not stat.S_ISREG(kind):
        found = "a folder" if stat.S_ISDIR(kind) else "a pipe, a device or the like"
        raise complain(f"{path} cannot be written", found, "a regular file, or a new name", kind=Error)
    return path.resolve() if path.is_symlink() else path


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it is renamed to `path` at the end, and removed after an error.

    A symbolic link stays, and the file that it leads to is replaced. The temporary path of another `whole_file` is
    yielded as it is.
    """
    if path in _unfinished:
        yield path
        return
    try:
        target = _target(path)
    except OSError as error:
        raise _unwritable(path, error) from None
    # A short name of ASCII, whatever the file's own name is.
    made = target.with_name(f".{secrets.token_hex(8)}{path.suffix}")
    _unfinished.add(made)
    try:
        # With the permissions of the umask; files of tempfile are readable by their owner alone.
        os.close(os.open(made, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield made
        made.replace(target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        _unfinished.discard(made)
        with contextlib.suppress(OSError):
            made.unlink()


@contextlib.contextmanager
def whole_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Yield a temporary path beside each of `paths`; they are renamed at the end, and removed after an error."""
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(whole_file(path)) for path in paths]


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Replace the name of a temporary file in errors by `path`, but for those about options."""
    try:
        yield
    except Error as error:
        if error.option is not None:
            raise
        parts = error.complaint
        found = parts.found or parts.what
        raise complain(f"{path} cannot be written", found, parts.wanted, parts.advice, kind=type(error)) from None


def _unwritable(path: Path, error: OSError) -> Error:
    reason = error.strerror or str(error)
    return complain(f"{path} cannot be written", reason, "a path in a folder that can be written to", kind=Error)


def save_array(array: Floats, path: Path) -> None:
    """Write float32 (h, w) or (h, w, 4), premultiplied, as .exr or .npy."""
    if check_suffix(path, FLOATS) == ".npy":
        with whole_file(path) as made, made.open("wb") as stream:
            np.save(stream, array, allow_pickle=False)
        return
    try:
        import OpenEXR  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise missing_package(f"{path} cannot be written", error) from error
    channels = {"Y": array} if array.ndim == 2 else dict(zip("RGBA", np.moveaxis(array, -1, 0), strict=True))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with whole_file(path) as made:
        try:
            planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
            with made.open("r+b") as stream:
                OpenEXR.File(header, planes).write(_utf8_name(made, stream.fileno()))
        except RuntimeError as error:
            raise complain(f"{path} cannot be written", str(error), kind=Error) from None


def _utf8_name(path: Path, handle: int) -> str:
    """Return a name for libraries that take UTF-8 alone: where `path` has none, that of its open file."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return f"/dev/fd/{handle}"
    return str(path)


def png_bytes(array: NDArray[Any], texts: Mapping[str, str]) -> bytes:
    """Return gray levels, RGB or RGBA of 8 bits as a PNG with some texts by their keywords."""
    from PIL import Image as PillowImage

    stream = io.BytesIO()
    PillowImage.fromarray(array).save(stream, format="PNG", pnginfo=_png_information(texts))
    return stream.getvalue()


def _png_information(texts: Mapping[str, str]) -> Any:
    from PIL.PngImagePlugin import PngInfo

    information = PngInfo()
    for keyword, text in texts.items():
        information.add_text(keyword, text)
    return information


def save_raster(array: NDArray[Any], path: Path, text: str = "", **more: Any) -> None:
    """Write gray levels, RGB or RGBA of 8 bits, or float32 (h, w), in the format of the suffix; whole or not at all.

    `text` goes into a PNG, under `png_text.KEYWORD`; `more`: options of Pillow.
    """
    from PIL import Image as PillowImage

    form, own = _RASTERS[check_suffix(path, tuple(_RASTERS))]
    options = {**own, **more}
    if text:
        options = {**options, "pnginfo": _png_information({KEYWORD: text})}
    with whole_file(path) as made:
        try:
            with made.open("r+b") as stream:
                PillowImage.fromarray(array).save(stream, format=form, **options)
        except (ValueError, SystemError, KeyError) as error:
            # Of pictures with more pixels than the format has, among others.
            raise complain(f"{path} cannot be written", str(error), "another format", kind=Error) from None


def save_channel(channel: Floats, path: Path) -> None:
    """Write coverage or depth, float32 (h, w): .exr, .npy, or .png scaled to its largest finite value."""
    if check_suffix(path, CHANNEL_SUFFIXES) != ".png":
        save_array(channel, path)
        return
    finite = np.where(np.isfinite(channel), channel, 0.0)
    top = float(finite.max(initial=0.0))
    _save_png(finite / top if top > 0 else finite, path)


def save_difference(picture: Floats, reference: Floats, path: Path, scale: float | None = None) -> float:
    """Write the absolute difference of two pictures of one shape, times `scale`, and return the scale.

    Unless given it is 1 for .exr and .npy, and makes the largest finite difference white in a .png, which is opaque.
    """
    difference = np.abs(picture - reference)
    if scale is None:
        top = float(np.where(np.isfinite(difference), difference, 0.0).max(initial=0.0))
        scale = 1.0 / top if path.suffix.lower() == ".png" and top > 0 else 1.0
    difference = difference * np.float32(scale)
    if check_suffix(path, CHANNEL_SUFFIXES) != ".png":
        save_array(difference, path)
        return scale
    # NaN counts as the largest difference; differences of opacity appear in all colours.
    levels = np.nan_to_num(difference, nan=1.0)
    _save_png(levels if levels.ndim == 2 else np.maximum(levels[..., :3], levels[..., 3:]), path)
    return scale


def _save_png(levels: NDArray[Any], path: Path) -> None:
    """Write levels from 0 to 1, (h, w) or (h, w, 3), with 8 bits."""
    from PIL import Image as PillowImage

    with whole_file(path) as made:
        PillowImage.fromarray(np.rint(np.clip(levels, 0, 1) * 255).astype(np.uint8)).save(made, format="PNG")


def read_picture(path: Path) -> Floats:
    """Return the picture of a .png, .exr or .npy file as float32: premultiplied (h, w, 4), or scalars (h, w).

    Raises InvalidInput for other files and for damaged ones, Error where the file cannot be read.
    """
    suffix = path.suffix.lower()
    readers = {".png": _read_png, ".exr": _read_exr, ".npy": _read_npy}
    if suffix not in readers:
        raise complain(f"{path} cannot be read as a picture", f"the suffix {suffix!r}", "one of: " + ", ".join(readers))
    if not path.is_file():
        raise complain(f"{path} cannot be read", "no such file", "a picture")
    with guarded(path, "a picture"):
        array = readers[suffix](path)
    if array.ndim == 3 and array.shape[2] == 3:
        array = np.concatenate([array, np.ones_like(array[..., :1])], axis=2)
    if array.size == 0 or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 4)):
        raise complain(f"{path} cannot be read as a picture", f"an array of shape {array.shape}", "(h, w, 4) or (h, w)")
    return array


def _read_png(path: Path) -> Floats:
    from PIL import Image as PillowImage

    with PillowImage.open(path, formats=["PNG"]) as picture:
        if picture.mode in ("L", "I;16", "1"):
            scale = np.float32(65535.0 if picture.mode == "I;16" else 255.0)
            return np.asarray(picture.convert("L") if picture.mode == "1" else picture, dtype=np.float32) / scale
        straight = np.asarray(picture.convert("RGBA"), dtype=np.float32) / np.float32(255.0)
    straight[..., :3] *= straight[..., 3:]
    return straight


def _read_exr(path: Path) -> Floats:
    import OpenEXR  # type: ignore[import-not-found, import-untyped, unused-ignore]

    with path.open("rb") as stream:
        name = _utf8_name(path, stream.fileno())
        channels: dict[str, Any] = OpenEXR.File(name, separate_channels=True).channels()
    planes = {name: np.asarray(channel.pixels, dtype=np.float32) for name, channel in channels.items()}
    if "Y" in planes:
        return planes["Y"]
    if not {"R", "G", "B"} <= planes.keys():
        found = ", ".join(planes)
        raise complain(f"{path} cannot be read as a picture", f"the channels {found}", "R, G, B and perhaps A, or Y")
    return np.stack([planes[name] for name in "RGBA" if name in planes], axis=-1)


def _read_npy(path: Path) -> Floats:
    with Source(path) as source:
        array: Floats = read_array(source).astype(np.float32)
    return array
