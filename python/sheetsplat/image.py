"""The result of a rendering. Conventions, sections 6 (Compositing) and 7 (Modes)."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from sheetsplat import _sheetsplat, pixels
from sheetsplat._checks import file_path, numbers, shown, truth
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.describe.schema import LONGEST
from sheetsplat.errors import Unsupported, complain, unusable
from sheetsplat.fields import has_values_at_points
from sheetsplat.limits import Depths
from sheetsplat.modes import TRAITS
from sheetsplat.notices import warn
from sheetsplat.options.core import documented
from sheetsplat.options.figure import AxesOptions, FigureOptions
from sheetsplat.options.renderer import Progress
from sheetsplat.plan import RenderPlan
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.supersampling import averaged, mean

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

    from sheetsplat.picking import Pick
    from sheetsplat.planes_in_view import PlanesInView
    from sheetsplat.scene import Scene


@dataclass(frozen=True, eq=False)
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
        volumes are measured at pixels of the picture, and mostly within a factor of 2.
    map
        Estimate of each pixel, root mean square over its channels, float32 (h, w); the mean of the squares is the
        square of `rmse`.

    Of a picture of several samples a pixel all of them are those of the samples, which their mean does not exceed.

    Examples
    --------
    >>> estimate = ss.render(values, size=(32, 32)).error
    >>> 0 < estimate.rmse < 0.2, estimate.map.shape
    (True, (32, 32))
    """

    rmse: float
    budget: dict[str, float]
    map: NDArray[np.float32]

    @classmethod
    def of_native(cls, native: _sheetsplat.ErrorEstimate, samples: int = 1) -> ErrorEstimate:
        """Return the estimate of the native module, of a picture of samples x samples a pixel.

        The square of a mean is at most the mean of the squares.
        """
        budget: dict[str, float] = {}
        for cause, rmse in native.budget:
            budget[cause] = float(np.hypot(budget.get(cause, 0.0), rmse))
        squares = None if samples == 1 else mean(np.square(native.map), samples)
        return cls(rmse=native.rmse, budget=budget, map=native.map if squares is None else np.sqrt(squares))

    def __eq__(self, other: object) -> bool:
        """Return whether all numbers are the same."""
        if not isinstance(other, ErrorEstimate):
            return NotImplemented
        return self.rmse == other.rmse and self.budget == other.budget and np.array_equal(self.map, other.map)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return a short description."""
        causes = ", ".join(f"{cause} {rmse:.2g}" for cause, rmse in self.budget.items())
        return f"ErrorEstimate({self.rmse:.2g}: {causes})"


class Image:
    """A picture, row 0 at the top, made by `Renderer.render`. It has either `rgba` or `scalar`, by the scene's mode.

    ``np.asarray(image)`` is what a screen shows: straight red, green, blue and alpha from 0 to 1, float32 (h, w, 4), as
    ``plt.imshow`` takes it; with ``dtype=np.uint8`` from 0 to 255. Scalars go through their colormap (`Scene`,
    ``scalar_colors``). The arrays stay valid after the image is gone.

    Pictures are equal where their pixels and further outputs are identical to the bit, and their recipes are equal;
    plan and times are not compared.

    Examples
    --------
    >>> image = ss.render(values, size=(40, 30))
    >>> image.rgba.shape, np.asarray(image, dtype=np.uint8).dtype
    ((30, 40, 4), dtype('uint8'))
    >>> image.save("cube.png")
    """

    __slots__ = (
        *("_coverage", "_depth", "_depth_limit", "_error", "_estimate", "_plan", "_recipe", "_rgba", "_scalar"),
        *("_scene", "_settings", "_stats"),
    )
    _error: ErrorEstimate | None
    _estimate: Callable[[Progress | None], ErrorEstimate] | None

    def __init__(
        self,
        native: _sheetsplat.Image,
        recipe: Recipe,
        estimate: Callable[[Progress | None], ErrorEstimate] | None = None,
        scene: Scene | None = None,
        depth_limit: Depths | None = None,
        planes: PlanesInView | None = None,
        other: _sheetsplat.Image | None = None,
    ) -> None:
        self._depth_limit = depth_limit
        samples = recipe.options["supersampling"]
        arrays = averaged(native, samples) if planes is None else planes.behind(native, other)
        self._rgba: NDArray[np.float32] | None = arrays.rgba
        self._scalar: NDArray[np.float32] | None = arrays.scalar
        self._coverage: NDArray[np.float32] | None = arrays.coverage
        self._depth: NDArray[np.float32] | None = arrays.depth
        self._plan = RenderPlan.of_native(native.plan, recipe.notes, None if scene is None else scene.quality, samples)
        self._settings: dict[str, Any] | None = native.settings
        self._stats: dict[str, float] = native.stats
        self._recipe = recipe
        self._error = None
        self._estimate = estimate
        self._scene = scene

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        """Pickle by arrays, without the scene; the error estimate goes along where it was computed, else it is lost."""
        parts = {name: getattr(self, name) for name in self.__slots__}
        return _of_parts, (parts | {"_estimate": None, "_scene": None},)

    def __eq__(self, other: object) -> bool:
        """Return whether pixels and further outputs are the same, and what is shown."""
        if not isinstance(other, Image):
            return NotImplemented
        arrays = ("_rgba", "_scalar", "_coverage", "_depth", "_depth_limit")
        pairs = ((getattr(self, name), getattr(other, name)) for name in arrays)
        return self._recipe == other._recipe and all(_same(one, two) for one, two in pairs)

    __hash__ = None  # type: ignore[assignment]

    @staticmethod
    def _there(name: str, array: NDArray[np.float32] | None, then: str) -> NDArray[np.float32]:
        if array is None:
            raise complain(f"the image has no {name}", advice=then)
        return array

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.pixels.shape[:2]
        return width, height

    @property
    def is_scalar(self) -> bool:
        """True for scalar modes, which make one number a pixel."""
        return self._scalar is not None

    @property
    def pixels(self) -> NDArray[np.float32]:
        """What was rendered, unchanged: `rgba`, or `scalar` in scalar modes."""
        found = self._scalar if self._rgba is None else self._rgba
        assert found is not None
        return found

    @property
    def rgba(self) -> NDArray[np.float32]:
        """Premultiplied, linear colour and opacity, float32 (h, w, 4). InvalidInput in scalar modes."""
        return self._there("rgba", self._rgba, "its mode is a scalar one: look at image.scalar")

    @property
    def scalar(self) -> NDArray[np.float32]:
        """Result of scalar modes, float32 (h, w). InvalidInput in modes that show colours.

        Where there is nothing on the ray of a pixel it is NaN, and 0 where the mode integrates.
        """
        return self._there("scalar", self._scalar, "its mode is a coloured one: look at image.rgba")

    @property
    def coverage(self) -> NDArray[np.float32]:
        """Line integral of the kernels' weights, float32 (h, w). InvalidInput unless asked for."""
        return self._there("coverage", self._coverage, 'render with outputs=("coverage",)')

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth at which opacity first reaches one half, float32 (h, w), infinite where none.

        Of several samples a pixel the nearest.

        InvalidInput unless asked for.
        """
        return self._there("depth", self._depth, 'render with outputs=("depth",)')

    @property
    def depth_limit(self) -> Depths | None:
        """Depths of the surface behind which nothing was drawn, float64 (h, w); None without one."""
        return self._depth_limit

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
        return self._settings

    @property
    def recipe(self) -> Recipe:
        """How it was made, without the data."""
        return self._recipe

    @property
    def camera(self) -> Camera:
        """The camera that shows it."""
        return self._recipe.camera

    @property
    def mode(self) -> str:
        """Mode of the scene."""
        found: str = self._recipe.options["mode"]
        return found

    @property
    def clim(self) -> tuple[float, float]:
        """The values at which the colours begin and end: of the first transfer function, or of a scalar picture."""
        if self._scalar is not None:
            colors: ScalarColors = self._recipe.options["scalar_colors"]
            return colors.limits(self._scalar, from_zero=TRAITS[self.mode].integrates)
        first = self._recipe.transfer_functions[0]
        return first.v_min, first.v_max

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
        return self.estimate_error()

    def estimate_error(self, progress: Progress | None = None) -> ErrorEstimate:
        """Return `error`, with a callback while it is computed.

        Parameters
        ----------
        progress
            As for `Renderer.render`: where it returns False, the estimate stops.

        Raises
        ------
        InvalidInput, Unsupported, OutOfMemory
            As `error`.
        Cancelled
            Where `progress` returned False; the error can be asked for again.
        """
        if self._error is None:
            if self._estimate is None:
                raise complain(
                    "the error of this picture cannot be estimated",
                    "a picture without its renderer and scene",
                    "one that Renderer.render returned",
                    "render it",
                )
            self._error = self._estimate(progress)
            self._estimate = None
        return self._error

    def with_rgba(self, rgba: ArrayLike) -> Image:
        """Return this picture with other colours, such as those of a composite with another picture.

        Parameters
        ----------
        rgba
            Premultiplied, linear colour and opacity, (h, w, 4).

        Raises
        ------
        InvalidInput
            In scalar modes, and for another shape.
        """
        colors = numbers("Image.with_rgba: rgba", rgba, f"an array of shape {self.rgba.shape}")
        if colors.shape != self.rgba.shape:
            found = f"an array of shape {colors.shape}"
            raise complain(unusable("Image.with_rgba: rgba"), found, f"an array of shape {self.rgba.shape}")
        parts = {name: getattr(self, name) for name in self.__slots__}
        return _of_parts(parts | {"_rgba": np.ascontiguousarray(colors, dtype=np.float32)})

    def save(self, path: str | os.PathLike[str], *, metadata: bool = True) -> None:
        """Write the picture in the format of the suffix; the file appears whole or not at all.

        Parameters
        ----------
        path
            .png, .webp: straight alpha, clamped, 8 bit, no gamma, nothing lost; scalar pictures through their colormap.
            .tif, .tiff: the same, and of scalar pictures the numbers themselves, float32.
            .jpg, .jpeg: over the scene's background, or white, without alpha.
            .exr: float32, premultiplied R, G, B, A, or Y for scalar pictures. .npy: `pixels` unchanged.
            .fits: the numbers of scalar pictures, float32, with unit and coordinates (``sheetsplat[astro]``).
        metadata
            Whether a PNG says how it was made (`recipe`), without paths and names of users, so that
            ``sheetsplat render x.png DATA`` makes it again. Pictures with a depth limit do not: a text cannot say what
            hid a part of them.

        Raises
        ------
        InvalidInput
            For another suffix, and for colours as .fits.
        Unsupported
            Where a package that writes the format is not installed.
        Error
            Where the file cannot be written.
        """
        import sheetsplat.io.pictures as pictures

        wanted = "a path that ends with " + pictures.listed_suffixes()
        target = file_path("the picture cannot be saved", path, wanted)
        described = truth("Image.save: metadata", metadata)
        suffix = pictures.check_suffix(target)
        if suffix in pictures.FLOATS:
            pictures.save_array(self.pixels, target)
            return
        if suffix == pictures.FITS:
            from sheetsplat.io.fits_picture import save_fits

            save_fits(self, target)
            return
        text = self._description() if described and self._depth_limit is None and suffix == ".png" else ""
        pictures.save_raster(self._raster(suffix), target, text)

    def to_png(self, *, metadata: bool = True, texts: Mapping[str, str] = MappingProxyType({})) -> bytes:
        """Return the bytes of the PNG that `save` writes, with further texts by their keywords."""
        from sheetsplat.io.pictures import png_bytes
        from sheetsplat.io.png_text import KEYWORD

        described = truth("Image.to_png: metadata", metadata)
        if not isinstance(texts, Mapping) or not all(isinstance(one, str) for pair in texts.items() for one in pair):
            raise complain(unusable("Image.to_png: texts"), shown(texts), "texts by their keywords")
        own = {KEYWORD: text} if described and (text := self._description()) else {}
        return png_bytes(self._raster(".png"), {**own, **texts})

    def _description(self) -> str:
        """Return the recipe as text, or "" with a warning where it has no text, or too long a one."""
        try:
            text = self._recipe.to_json()
        except (TypeError, ValueError) as error:
            warn(f"the picture does not say how it was made: {error}")
            return ""
        if len(text) > LONGEST:
            warn(f"the picture does not say how it was made: the text would have {len(text)} characters")
            return ""
        return text

    def _raster(self, suffix: str) -> NDArray[Any]:
        """Return the array that a raster format holds."""
        if self._scalar is not None and suffix in (".tif", ".tiff"):
            return self._scalar
        colors: ScalarColors = self._recipe.options["scalar_colors"]
        if self._scalar is not None and colors.is_gray and not np.isnan(self._scalar).any():
            return pixels.gray_levels(self._scalar, colors, self.clim)
        shown_levels = self._levels(255)
        if suffix in (".jpg", ".jpeg"):
            return pixels.over(shown_levels, pixels.WHITE)
        return shown_levels

    def _levels(self, most: int) -> NDArray[Any]:
        return pixels.levels(self.pixels, self._recipe.options["scalar_colors"], self.clim, most)

    def to_pil(self) -> PillowImage:
        """Return the picture as an image of Pillow: RGBA, 8 bit, straight alpha, as `save` writes a PNG."""
        from PIL import Image as Pillow

        return Pillow.fromarray(self._levels(255))

    def show(self) -> None:
        """Show the picture: below the cell of a notebook, else in the program of this machine that shows pictures.

        Raises
        ------
        Unsupported
            Where there is no such program, as on a machine without a display.
        """
        from PIL import ImageShow

        # Only a notebook has imported it.
        shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
        if hasattr(shell, "kernel"):
            sys.modules["IPython"].display.display(self)
            return
        # Programs without a display tell that to the terminal, not to their caller.
        has_display = sys.platform in ("win32", "darwin") or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
        if not has_display or not ImageShow.show(self.to_pil(), title="sheetsplat"):
            raise complain(
                "the picture cannot be shown",
                "no program that shows pictures, or no display",
                "one that Pillow finds, such as xdg-open",
                "save it, or look at it in a notebook",
                kind=Unsupported,
            )

    @documented(AxesOptions)
    def to_axes(self, ax: Any = None, **options: Unpack[AxesOptions]) -> Any:
        """Show the picture in axes of matplotlib, with a colour bar in units of the data.

        Parameters
        ----------
        ax
            The axes; those of a new figure of pyplot unless given.
        **options
            Those of AxesOptions.

        Returns
        -------
        matplotlib.axes.Axes
            The axes of the picture, in the plane through the camera's target: in coordinates of the data where these
            have some and the view is along one of their axes, else in world units.

        Raises
        ------
        InvalidInput
            For fonts that are not there, and what is no text or number.
        Unsupported
            Where matplotlib is not installed; it comes with ``pip install "sheetsplat[plot]"``.
        """
        from sheetsplat.figure import to_axes

        return to_axes(self, ax, options)

    @documented(FigureOptions)
    def annotated(self, **options: Unpack[FigureOptions]) -> PillowImage:
        """Return the picture with what a figure needs, as an RGB image of Pillow; no pixel is scaled.

        Parameters
        ----------
        **options
            Those of FigureOptions.

        Raises
        ------
        InvalidInput, Unsupported
            As `to_axes`.
        """
        from sheetsplat.figure import annotated

        return annotated(self, options)

    @documented(FigureOptions)
    def save_figure(self, path: str | os.PathLike[str], **options: Unpack[FigureOptions]) -> None:
        """Write the figure that `annotated` returns; the file appears whole or not at all.

        Parameters
        ----------
        path
            .pdf, .svg: letters and lines as such, the picture in its pixels. .png, .jpg, .tif, .webp: all in pixels.
        **options
            Those of FigureOptions.

        Raises
        ------
        InvalidInput, Unsupported
            As `to_axes`; InvalidInput for another suffix.
        Error
            Where the file cannot be written.
        """
        import sheetsplat.io.pictures as pictures
        from sheetsplat.figure import save_figure

        wanted = "a path that ends with " + pictures.listed_suffixes(pictures.FIGURES)
        save_figure(self, file_path("the figure cannot be saved", path, wanted), options)

    def pick(self, x: float, y: float) -> Pick | None:
        """Return what is seen at a pixel: its position in the world, and the field there; None where nothing is seen.

        The field is evaluated in float64 on the slices of the picture, by the kernels themselves: sampling by slabs,
        pre-integration and filters do not count. The image keeps its scene for this.

        Parameters
        ----------
        x, y
            Column from the left and row from the top, in pixels; parts of a pixel do not count.

        Raises
        ------
        InvalidInput
            For a pixel outside the picture, and for a picture without its scene, as one from a pickle.
        Unsupported
            For pictures of scattered kernels in bricks, and of volumes in bricks that another process opened.
        """
        from sheetsplat.picking import pick

        if self._scene is None:
            wanted = "its scene: a picture that a Renderer returned"
            raise complain("the picture cannot be picked", "a picture alone", wanted)
        if not all(map(has_values_at_points, self._scene.fields)):
            found = "a picture of data in bricks, which are not in memory"
            raise complain("the picture cannot be picked", found, "one of data in memory", kind=Unsupported)
        return pick(self, self._scene, x, y)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return straight red, green, blue and alpha, 0 to 1, or 0 to the largest number of an unsigned type."""
        kind = np.dtype(np.float32 if dtype is None else dtype)
        if copy is False:
            raise ValueError("an Image holds premultiplied colours, or scalars: what it shows is a copy")
        if kind in (np.dtype(np.uint8), np.dtype(np.uint16)):
            return self._levels(int(np.iinfo(kind).max))
        if kind.kind != "f":
            raise complain(
                f"the picture cannot become an array of {kind}", wanted="a floating-point type, uint8 or uint16"
            )
        straight = pixels.straight(self.pixels, self._recipe.options["scalar_colors"], self.clim)
        return straight.astype(kind, copy=False)

    def _repr_png_(self) -> bytes:
        import io

        stream = io.BytesIO()
        self.to_pil().save(stream, format="PNG")
        return stream.getvalue()

    def __repr__(self) -> str:
        """Return a short description."""
        width, height = self.size
        low, high = self.clim
        return (
            f"Image({width} x {height}, {'scalar' if self.is_scalar else 'rgba'}, mode {self.mode!r}, colours from "
            f"{low:g} to {high:g}, {self._plan.backend})"
        )


def image_of(
    recipe: Recipe,
    plan: RenderPlan,
    stats: dict[str, float],
    *,
    rgba: NDArray[np.float32] | None = None,
    scalar: NDArray[np.float32] | None = None,
    coverage: NDArray[np.float32] | None = None,
    depth: NDArray[np.float32] | None = None,
    depth_limit: Depths | None = None,
    scene: Scene | None = None,
    estimate: Callable[[Progress | None], ErrorEstimate] | None = None,
) -> Image:
    """Return the image of arrays that were drawn in parts; `estimate` finds its error."""
    parts: dict[str, Any] = dict.fromkeys(Image.__slots__)
    own = {"rgba": rgba, "scalar": scalar, "coverage": coverage, "depth": depth, "depth_limit": depth_limit}
    told = {"recipe": recipe, "plan": plan, "stats": stats, "scene": scene, "estimate": estimate}
    return _of_parts(parts | {f"_{name}": part for name, part in (own | told).items()})


def pixels_of(picture: Any) -> Any:
    """Return what was rendered, unchanged, of an image; anything else as it is."""
    return picture.pixels if isinstance(picture, Image) else picture


def _same(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)


def _of_parts(parts: dict[str, Any]) -> Image:
    """Return the image of all its parts by their names."""
    image = Image.__new__(Image)
    for name, part in parts.items():
        setattr(image, name, part)
    return image
