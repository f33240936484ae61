"""Volumes that end in different places and add up: told."""

from __future__ import annotations

from sheetsplat.fields import RegularField
from sheetsplat.notices import warn
from sheetsplat.scene import Scene


def warn_of_ends(scene: Scene) -> None:
    """Warn of volumes in one group that are drawn as if they fell to 0, where its fields end in different places."""
    for group in scene.groups:
        volumes = [one for one in group if isinstance(one, RegularField) and one.size and one.boundary == "edge"]
        others = len(volumes) < len(group)
        if not volumes or not others and len({(one.centre_bounds, one.spacing, one.lattice) for one in volumes}) == 1:
            continue
        if any(one.base != 0.0 for one in volumes):
            warn(
                "fields that add up end in different places: their volumes fall to 0 at their boundaries, through all "
                "values between; give each a transfer function of its own, or join them into one array"
            )
            return
