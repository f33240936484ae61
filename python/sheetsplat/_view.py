"""What a picture shows: the checked arguments that pictures and plans have."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from sheetsplat import _sheetsplat
from sheetsplat._checks import image_size, instance, names
from sheetsplat.camera import Camera
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import any_in_bricks
from sheetsplat.limits import Depths, checked_depths
from sheetsplat.options.renderer import OUTPUTS
from sheetsplat.planes_in_view import PlanesInView
from sheetsplat.scene import Scene
from sheetsplat.supersampling import fine_depths, fine_size


def _names(outputs: object) -> tuple[str, ...]:
    return names("Renderer: outputs", outputs, OUTPUTS)


class View(NamedTuple):
    """What a picture shows: the checked arguments that pictures and plans have."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    outputs: tuple[str, ...]
    depth_limit: Depths | None
    planes: PlanesInView | None

    @classmethod
    def of(cls, scene: Scene, camera: Camera, size: object, outputs: object, depth_limit: ArrayLike | None) -> View:
        """Return the view of arguments, or InvalidInput."""
        instance("Renderer: scene", scene, Scene)
        instance("Renderer: camera", camera, Camera)
        if any_in_bricks(scene.fields):
            raise complain(
                "Renderer: the scene cannot be drawn",
                "data in bricks",
                "data in memory",
                "draw it with sheetsplat.render, which draws it brick by brick",
                kind=Unsupported,
            )
        pixels = image_size(size)
        limit = checked_depths(depth_limit, camera, pixels)
        return cls(scene, camera, pixels, _names(outputs), limit, PlanesInView.of(scene, camera, pixels, limit))

    @property
    def samples(self) -> int:
        """Samples a pixel along each axis."""
        return self.scene.supersampling

    @property
    def native_scene(self) -> _sheetsplat.Scene:
        """The scene of the native renderer, to which depth limits belong; a background comes behind slice planes."""
        planes = self.planes
        native = (self.scene if planes is None else planes.in_front).native
        limit = fine_depths(self.depth_limit, self.samples) if planes is None else planes.limit(self.depth_limit)
        return native if limit is None else native.with_depth_limit(limit)

    def native(self) -> dict[str, Any]:
        """Return the arguments of the native renderer, which draws a pixel for each sample."""
        size = fine_size(self.size, self.samples)
        also = {name: name in self.outputs for name in OUTPUTS}
        return {"scene": self.native_scene, "camera": self.camera.native, "size": size, **also}

    def second(self, **changes: Any) -> dict[str, Any] | None:
        """Return the arguments for the second picture of slice planes, with some options of the scene changed.

        None where there is none.
        """
        limit = None if self.planes is None else self.planes.other_limit(self.depth_limit)
        if self.planes is None or limit is None:
            return None
        scene = self.planes.in_front.sketch(**changes) if changes else self.planes.in_front
        size = fine_size(self.size, self.samples)
        native = scene.native.with_depth_limit(limit)
        return {"scene": native, "camera": self.camera.native, "size": size, **dict.fromkeys(OUTPUTS, False)}
