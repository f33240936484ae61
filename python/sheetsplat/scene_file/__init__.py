"""Scene files: TOML that says what `sheetsplat.render` is told, and makes the same picture from the same data."""

from sheetsplat.scene_file.file import SceneFile

__all__ = ["SceneFile"]
