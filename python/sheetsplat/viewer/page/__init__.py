"""The page of the viewer: HTML, style and script, as they are served, and as a widget takes them."""
