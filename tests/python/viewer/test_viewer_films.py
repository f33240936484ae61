"""Films that a page of the viewer orders."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image as Pillow
from viewer_pages import Page, volume

import sheetsplat as ss
from sheetsplat.viewer import protocol


@pytest.mark.slow
def test_films_are_made_beside_the_pictures(opened):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    session = opened(times=[volume(), 0.5 * volume(0.3), 0.2 * volume()])
    page = Page(session)
    page.wait("about")
    order = {"type": "film", "frames": 3, "fps": 10, "kind": "gif", "width": 32, "height": 24}
    for what, backdrop, mode in (("turn", "#204060", "composite"), ("times", "#ffffff", "isosurface"),
                                 ("turn", "#000000", "mip")):  # fmt: skip
        page.set(backdrop=backdrop, mode=mode)
        page.wait("frame", last=True)
        page.clear()
        page.say(**order, what=what)
        message, payload = page.wait("file")
        assert message["name"].endswith(".gif") and message["kind"] == "image/gif"
        page.wait("filmed", stopped=False)
        film = Pillow.open(io.BytesIO(payload))
        assert film.n_frames == 3 and film.size == (32, 24)
        corner = np.asarray(film.convert("RGB"))[0, 0]
        wanted = np.array([int(backdrop[n : n + 2], 16) for n in (1, 3, 5)])
        assert mode == "mip" or np.abs(corner - wanted).max() <= 8
    # What is filmed is what was shown when it was ordered.
    wanted = ss.turntable(session.scene(), frames=3, camera=session.state.camera, size=(32, 24), backend="cpu")
    assert [camera.eye for camera in wanted.cameras][0] == session.state.camera.eye


def test_films_are_given_up_and_refused(opened):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    session = opened()
    page = Page(session)
    page.wait("about")
    order = {"type": "film", "what": "turn", "frames": 2000, "fps": 10, "kind": "gif", "width": 48, "height": 40}
    page.say(**order)
    page.wait("filming")
    page.say(**order)
    assert "a film is being made" in page.wait("error")[0]["text"]
    page.say(type="film_stop")
    page.wait("filmed", stopped=True)
    page.clear()
    page.say(**{**order, "what": "times"})
    assert "one time" in page.wait("error")[0]["text"]
    page.wait("filmed", stopped=True)
    # A page that goes takes its film with it.
    page.clear()
    page.say(**order)
    page.wait("filming")
    session.disconnect(page.client)
    page.wait("filmed", stopped=True)
    for wrong in ({"frames": 1}, {"frames": 3000}, {"kind": "exe"}, {"what": "all"}, {"fps": 0}, {"width": 0}):
        assert protocol.parse(json.dumps({**order, **wrong})) is None
    assert protocol.parse(json.dumps(order)) is not None
