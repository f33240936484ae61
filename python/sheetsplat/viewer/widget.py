"""The viewer as a widget of notebooks. Needs anywidget."""

from __future__ import annotations

from typing import Any

from sheetsplat.errors import missing_package
from sheetsplat.viewer.page import files
from sheetsplat.viewer.session import Session


def make_widget(session: Session) -> Any:
    """Return a widget that shows a session; each place where it is displayed is a page of its own.

    Raises Unsupported where anywidget is not installed.
    """
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise missing_package("the viewer cannot be shown in a notebook", error) from None

    class ViewerWidget(anywidget.AnyWidget):
        """Carries messages between the page in a notebook and a session."""

        _esm = files.widget_script()
        _css = files.style()
        height = traitlets.Int(520).tag(sync=True)

    widget = ViewerWidget()
    clients: dict[str, Any] = {}

    def received(_: Any, content: Any, buffers: Any) -> None:
        # Places of one widget share a channel: each message names its place.
        place = content.get("place") if isinstance(content, dict) else None
        if not isinstance(place, str) or len(place) > 64:
            return
        if content.get("type") == "bye":
            if place in clients:
                session.disconnect(clients.pop(place))
            return
        if place not in clients:
            if len(clients) >= 32:
                return

            def deliver(message: dict[str, Any], payload: bytes) -> None:
                widget.send({**message, "place": place}, [payload] if payload else None)

            clients[place] = session.connect(deliver)
        session.receive(clients[place], {name: part for name, part in content.items() if name != "place"})

    widget.on_msg(received)
    return widget
