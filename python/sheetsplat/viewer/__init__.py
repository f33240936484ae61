"""The viewer: `view` shows data in a page of the browser or in a notebook, where they can be looked at from all sides.

`session` holds what is shown and draws it, in a thread of its own; `server` and `widget` carry its messages to a page
(websocket) or to a notebook (anywidget); `page` is what both show.
"""

from sheetsplat.viewer.viewer import Viewer, view

__all__ = ["Viewer", "view"]
