"""The result of a rendering. Conventions, sections 6 (Compositing) and 7 (Modes)."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import shown
from sheetsplat.errors import complain
from sheetsplat.plan import RenderPlan


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated distance of a picture from the converged one.

    The converged picture is the limit of vanishing slice distances, without an opacity stop, in exact arithmetic.

    Attributes
    ----------
    rmse
        Root mean square difference over all pixels and channels: of premultiplied colours and opacity, 0 to 1; in the
        scalar modes, of scalars divided by the largest one where that is above 1. So do conventions, section 8, and
        ``sheetsplat.compare.compare``.
    budget
        The parts of `rmse` by cause, whose squares add up to its square. Those of shadows and ambient occlusion from
        volumes are not measured but taken from the plan, which mostly overestimates them.
    map
        Estimate of each pixel, root mean square over its channels, float32 (h, w); the mean of the squares is the
        square of `rmse`.
    """

    rmse: float
    budget: dict[str, float]
    map: NDArray[np.float32]

    @classmethod
    def of_native(cls, native: _sheetsplat.ErrorEstimate) -> ErrorEstimate:
        """Return the estimate of the native module."""
        budget: dict[str, float] = {}
        for cause, rmse in native.budget:
            budget[cause] = float(np.hypot(budget.get(cause, 0.0), rmse))
        return cls(rmse=native.rmse, budget=budget, map=native.map)

    def __repr__(self) -> str:
        """Return a short description."""
        causes = ", ".join(f"{cause} {rmse:.2g}" for cause, rmse in self.budget.items())
        return f"ErrorEstimate({self.rmse:.2g}: {causes})"


class Image:
    """A picture, row 0 at the top, made by `Renderer.render`. It has either `rgba` or `scalar`, by the scene's mode.

    ``np.asarray(image)`` returns that array. The arrays stay valid after the image is gone.
    """

    __slots__ = ("_coverage", "_depth", "_error", "_estimate", "native", "_plan", "_rgba", "_scalar", "_stats")

    def __init__(self, native: _sheetsplat.Image, estimate: Callable[[], ErrorEstimate] | None = None) -> None:
        self.native = native
        self._rgba: NDArray[np.float32] | None = native.rgba
        self._scalar: NDArray[np.float32] | None = native.scalar
        self._coverage: NDArray[np.float32] | None = native.coverage
        self._depth: NDArray[np.float32] | None = native.depth
        self._plan = RenderPlan.of_native(native.plan)
        self._stats: dict[str, float] = native.stats
        self._error: ErrorEstimate | None = None
        self._estimate = estimate

    @staticmethod
    def _there(name: str, array: NDArray[np.float32] | None, then: str) -> NDArray[np.float32]:
        if array is None:
            raise complain(f"the image has no {name}", advice=then)
        return array

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.native.size

    @property
    def is_scalar(self) -> bool:
        """True for the modes "xray", "mip", "minimum" and "average"."""
        return self._scalar is not None

    @property
    def rgba(self) -> NDArray[np.float32]:
        """Premultiplied, linear colour and opacity, float32 (h, w, 4). InvalidInput in scalar modes."""
        return self._there("rgba", self._rgba, "its mode is a scalar one: look at image.scalar")

    @property
    def scalar(self) -> NDArray[np.float32]:
        """Result of the modes "xray", "mip", "minimum" and "average", float32 (h, w). InvalidInput in other modes."""
        return self._there("scalar", self._scalar, "its mode is a coloured one: look at image.rgba")

    @property
    def coverage(self) -> NDArray[np.float32]:
        """Line integral of the kernels' weights, float32 (h, w). InvalidInput unless asked for."""
        return self._there("coverage", self._coverage, 'render with outputs=("coverage",)')

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth at which opacity first reaches one half, float32 (h, w), infinite where none.

        InvalidInput unless asked for.
        """
        return self._there("depth", self._depth, 'render with outputs=("depth",)')

    @property
    def plan(self) -> RenderPlan:
        """The plan that was carried out."""
        return self._plan

    @property
    def stats(self) -> dict[str, float]:
        """Seconds per stage, slices, kernels drawn and culled, bytes."""
        return dict(self._stats)

    @property
    def settings(self) -> dict[str, Any] | None:
        """Options that max_error or max_seconds chose in place of those of the scene; None without them."""
        return self.native.settings

    @property
    def error(self) -> ErrorEstimate:
        """Estimated distance of this picture from the converged one, by cause and by pixel.

        It is computed at the first access, from further pictures of the same view, which take about four times as long
        as this one; the image keeps renderer and scene until then. Ctrl-C stops it.

        Raises
        ------
        InvalidInput
            For a coarse stage of a progressive rendering.
        Unsupported, OutOfMemory
            Where the further pictures cannot be rendered.
        """
        if self._error is None:
            if self._estimate is None:
                raise complain(
                    "the error of this picture cannot be estimated",
                    "a picture without its renderer and scene",
                    "one that Renderer.render returned",
                    "render it",
                )
            self._error = self._estimate()
            self._estimate = None
        return self._error

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture in the format of the suffix; the file appears whole or not at all.

        Parameters
        ----------
        path
            .png: straight alpha, clamped, 8 bit, no gamma; scalar pictures are scaled to their largest value.
            .exr: float32, premultiplied R, G, B, A, or Y for scalar pictures. .npy: the array unchanged.

        Raises
        ------
        InvalidInput
            For another suffix.
        Error
            Where the file cannot be written.
        """
        import sheetsplat.io.pictures as pictures

        if not isinstance(path, str | os.PathLike) or "\0" in os.fsdecode(path):
            raise complain("the picture cannot be saved", shown(path), "a path that ends with .png, .exr or .npy")
        target = Path(os.fsdecode(path))
        if pictures.check_suffix(target) == ".png":
            # The native writer makes the file whole or not at all by itself.
            self.native.save_png(str(target))
        else:
            pictures.save_array(np.asarray(self), target)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return `rgba` or `scalar`, by the mode of the scene."""
        array = self._scalar if self._rgba is None else self._rgba
        if copy is False and dtype is not None and np.dtype(dtype) != np.float32:
            raise ValueError(f"an Image is float32; it cannot be seen as {np.dtype(dtype)} without a copy")
        return np.array(array, dtype=dtype, copy=copy or None)

    def _repr_png_(self) -> bytes:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "image.png"
            self.native.save_png(str(path))
            return path.read_bytes()

    def __repr__(self) -> str:
        """Return a short description."""
        width, height = self.size
        return f"Image({width} x {height}, {'scalar' if self.is_scalar else 'rgba'}, {self._plan.backend})"
