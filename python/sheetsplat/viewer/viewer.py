"""`view` shows data in a page of the browser, or in a notebook; a `Viewer` is its end in Python."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import webbrowser
from typing import TYPE_CHECKING, Any, Unpack

from sheetsplat._checks import file_path, image_size, instance, shown, truth, whole
from sheetsplat.camera import Camera
from sheetsplat.errors import complain, unusable
from sheetsplat.options.core import check_names, documented
from sheetsplat.options.picture import RenderOptions
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.session import Session

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sheetsplat.image import Image
    from sheetsplat.scene import Scene
    from sheetsplat.viewer.server import Server

_SIZE = (800, 600)
_LOCAL = "127.0.0.1"
# How late Ctrl-C may be seen, in seconds.
_NAP = 0.25


def in_notebook() -> bool:
    """Return whether this is a kernel of Jupyter."""
    get_ipython: Any = getattr(sys.modules.get("IPython"), "get_ipython", None)
    shell = get_ipython() if get_ipython is not None else None
    return hasattr(shell, "kernel")


class Viewer:
    """Shows data in pages of the browser and in notebooks; made by `sheetsplat.view`.

    All pages and widgets of a viewer show the same: what is changed in one changes in all, and here. A viewer ends with
    `close`, at the end of a ``with`` block, or with the process.

    Examples
    --------
    >>> with ss.view(values, browser=False, cmap="magma") as viewer:
    ...     "magma" in viewer.code()  # Python that makes the picture
    True
    """

    def __init__(self, session: Session, host: str, port: int) -> None:
        self._session, self._host, self._port = session, host, port
        self._server: Server | None = None
        self._widget: Any = None
        self._lock = threading.Lock()
        self._done = threading.Event()

    @property
    def url(self) -> str:
        """The link of the page, which is served from the first time that it is asked for.

        Whoever knows it, and can reach the address, sees the data and can change the picture.
        """
        return self._serving().url

    def _serving(self) -> Server:
        with self._lock:
            if self._done.is_set():
                raise complain("the viewer has no page", "a viewer that was closed", "", "view the data again")
            if self._server is None:
                from sheetsplat.viewer.server import Server

                self._server = Server(self._session, self._host, self._port)
                self._session.expect()
            return self._server

    @property
    def widget(self) -> Any:
        """The widget of notebooks, from anywidget; Unsupported where that is not installed."""
        if self._widget is None:
            from sheetsplat.viewer.widget import make_widget

            self._widget = make_widget(self._session)
            self._session.expect()
        return self._widget

    @property
    def scene(self) -> Scene:
        """The scene that is shown."""
        return self._session.scene()

    @property
    def camera(self) -> Camera:
        """The camera that shows it; another one may be set."""
        return self._session.state.camera

    @camera.setter
    def camera(self, camera: Camera) -> None:
        instance("Viewer: camera", camera, Camera)
        self._session.look_from(camera)

    def render(self, size: tuple[int, int] | None = None) -> Image:
        """Return the picture that is shown, complete.

        Parameters
        ----------
        size
            (width, height) in pixels; that of the page unless given.
        """
        return self._session.picture(None if size is None else image_size(size))

    def save(self, path: str | os.PathLike[str], size: tuple[int, int] | None = None) -> None:
        """Write the picture that is shown, as `Image.save` does, or the scene as a scene file.

        Parameters
        ----------
        path
            The file; its suffix says the format: .toml for a scene file, from which ``sheetsplat render`` makes the
            picture, and ``view`` goes on.
        size
            As for `render`.
        """
        if file_path("the picture cannot be saved", path, "a path").suffix.lower() == ".toml":
            self._session.scene_file().save(path)
        else:
            self.render(size).save(path)

    def code(self) -> str:
        """Return Python that makes the picture that is shown."""
        return self._session.code()

    def open_browser(self) -> bool:
        """Open the page in the browser of this machine; return whether one was found.

        The browser is given a file that leads to the page, which no other user can read, until the viewer is closed.
        """
        server = self._serving()
        with contextlib.suppress(webbrowser.Error, OSError):
            return webbrowser.open(server.redirection().as_uri())
        return False

    def wait(self) -> None:
        """Wait until the viewer is closed; Ctrl-C closes it."""
        try:
            # A signal that comes right before the thread falls asleep is seen when it wakes.
            while not self._done.wait(_NAP):
                pass
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """Stop drawing and serving; pages say that the viewer has ended."""
        self._done.set()
        self._session.close()
        with self._lock:
            server, self._server = self._server, None
        if server is not None:
            server.close()

    def __enter__(self) -> Viewer:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()

    def _repr_mimebundle_(self, **given: Any) -> Any:
        return self.widget._repr_mimebundle_(**given)  # noqa: SLF001  # IPython's protocol

    def __repr__(self) -> str:
        """Return a short description, without the link."""
        state = "closed" if self._done.is_set() else "open"
        return f"Viewer({self._session.shown.title(0, 0)!r}, {state})"


@documented(RenderOptions, chooses=True)
def view(
    data: Any = None,
    *,
    choices: Mapping[str, Any] | Sequence[Any] | None = None,
    times: Mapping[str, Any] | Sequence[Any] | None = None,
    browser: bool | None = None,
    host: str = _LOCAL,
    port: int = 0,
    **options: Unpack[RenderOptions],
) -> Viewer:
    """Show data in a page of the browser, or in a notebook as a widget, and return the viewer.

    It shows first what `render` would, and every option of `render` has its meaning. The process must go on for the
    page to work: a script ends with ``viewer.wait()``.

    Parameters
    ----------
    data
        As for `render`; or a scene file, a `SceneFile` or its path. A file with several time steps (NetCDF, OME-Zarr,
        .pvd) is shown with a slider. Data in bricks (`open_bricks`) are shown by coarse copies at once, and drawn by
        this process, or by the workers of `client`, when the view rests.
    choices
        In place of `data`: several data, by name or as a sequence, among which the page lets choose.
    times
        In place of `data`: data of one time each, in their order, which share the look of the first; the page has a
        slider. Files are read when their time is shown.
    browser
        Whether to open a browser; unless given, outside of notebooks.
    host
        Address at which the page is served; the default, 127.0.0.1, can be reached from this machine alone. With
        "0.0.0.0" everybody who can reach this machine and knows the link sees the data, and the link goes through the
        network unencrypted.
    port
        Port of the page; 0: any free one.
    **options
        Those of RenderOptions.

    Raises
    ------
    Unsupported
        Where the page or the widget needs a package that is not installed: ``pip install "sheetsplat[view]"`` for
        pages, ``pip install "sheetsplat[jupyter]"`` for notebooks.
    Error
        What `render` raises before it draws.

    Examples
    --------
    In a script, until Ctrl-C:

    >>> viewer = ss.view("bonsai.nrrd")  # doctest: +SKIP
    >>> viewer.wait()  # doctest: +SKIP
    """
    check_names("view", options, RenderOptions, ("choices", "times", "browser", "host", "port"))
    number = whole("view: port", port)
    if not 0 <= number < 1 << 16:
        raise complain(unusable("view: port"), str(number), "from 0 to 65535")
    if not isinstance(host, str) or not host:
        raise complain(unusable("view: host"), shown(host), 'an address such as "127.0.0.1"')
    opens = None if browser is None else truth("view: browser", browser)
    session = Session(Shown(data, options, choices, times), _SIZE)
    viewer = Viewer(session, host, number)
    notebook = in_notebook()
    if notebook and not opens:
        # What is missing is told here, not where the notebook displays it.
        assert viewer.widget is not None
    elif opens or (opens is None and not notebook):
        viewer.open_browser()
    return viewer
