"""Volumes that end in different places and add up: told."""

from __future__ import annotations

from sheetsplat.fields import RegularField
from sheetsplat.notices import warn
from sheetsplat.scene import Scene


def warn_of_ends(scene: Scene) -> None:
    """Warn of volumes in one group that are drawn as if they fell to 0, where its fields end in different places."""
    for group in scene.groups:
        ends = [one.domain if isinstance(one, RegularField) else None for one in group]
        volumes = [one for one, end in zip(group, ends, strict=True) if end is not None and one.size]
        if len(set(ends)) > 1 and any(one.base != 0.0 for one in volumes):
            warn(
                "fields that add up end in different places: their volumes fall to 0 at their boundaries, through all "
                "values between; give each a transfer function of its own, or join them into one array"
            )
            return
