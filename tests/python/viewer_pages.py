"""A page of the viewer without a browser, and data and changes for it."""

from __future__ import annotations

import io
import threading
from contextlib import contextmanager

import numpy as np
from PIL import Image as Pillow

from attacks import changes
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.session import Session

SIZE = (48, 40)
PATIENCE = 60.0


def volume(shift=0.0, n=14):
    z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, n)], indexing="ij")
    return (100.0 * np.exp(-2.0 * ((x - shift) ** 2 + y**2 + (1.5 * z) ** 2))).astype(np.float32)


class Page:
    """Takes messages as a page does, and says that it drew each frame."""

    def __init__(self, session, size=SIZE):
        self.session, self.messages, self.news = session, [], threading.Condition()
        self.draws = True
        self.client = session.connect(self._take)
        self.say(type="hello", width=size[0], height=size[1])

    def _take(self, message, payload):
        with self.news:
            self.messages.append((message, payload))
            self.news.notify_all()
        if message["type"] == "frame" and self.draws:
            threading.Thread(target=self.say, kwargs={"type": "drawn", "number": message["number"]}).start()

    def say(self, **message):
        self.session.receive(self.client, message)

    def set(self, **changes):
        self.clear()
        self.say(type="set", changes=changes)

    def clear(self):
        with self.news:
            self.messages.clear()

    def wait(self, kind, **parts):
        """Return the first message of a kind, with these parts, and its bytes."""

        def found():
            return next((one for one in self.messages if self._fits(one[0], kind, parts)), None)

        with self.news:
            assert self.news.wait_for(found, PATIENCE), (kind, parts, [one["type"] for one, _ in self.messages])
            return found()

    @staticmethod
    def _fits(message, kind, parts):
        return message["type"] == kind and all(message.get(name) == value for name, value in parts.items())


@contextmanager
def opened_sessions():
    """Give a function that opens a session of data; all are closed in the end."""
    sessions = []

    def make(data=None, choices=None, times=None, **options):
        given = volume() if data is None and choices is None and times is None else data
        options = {"backend": "cpu", "threads": 1, **options}
        sessions.append(Session(Shown(given, options, choices, times), SIZE))
        return sessions[-1]

    yield make
    for one in sessions:
        one.close()


def picture_of(message, payload):
    made = np.asarray(Pillow.open(io.BytesIO(payload)).convert("RGB"))
    assert list(made.shape[1::-1]) == message["size"]
    return made


#: Those that change the composited picture of one field, a value each.
_SEEN = ("camera", "material", "lights", "clip", "depth_cue", "ambient_occlusion", "gradient_opacity", "background")
CHANGES = {name: changes.CHANGES[name][0] for name in (*_SEEN, "shadows", "look")}


def made_by(code, data, **options):
    """Return the image that code makes; `data` and renderer options stand for what the code has names for."""
    names = {"data": data}
    exec(code.replace('image.save("picture.png")', ""), names)
    return names["image"]
