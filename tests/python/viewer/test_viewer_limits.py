"""What the viewer's server grants to strangers, slow and idle connections, and when pages count as gone."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import os
import socket
import subprocess
import sys
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

from sheetsplat.viewer.connections import Limits
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.server import Server
from sheetsplat.viewer.session import Session
from sheetsplat.viewer.widget import Places

pytest.importorskip("aiohttp", reason="aiohttp is not installed")

VALUES = np.linspace(0, 1, 64, dtype=np.float32).reshape(4, 4, 4)
PATIENCE = 30.0


@pytest.fixture
def served():
    """Return a function that serves a session with limits and returns it and its link."""
    with contextlib.ExitStack() as ends:

        def make(**limits):
            session = Session(Shown(VALUES, {"backend": "cpu", "threads": 1}, None, None))
            server = Server(session, limits=Limits(**limits))
            ends.callback(session.close)
            ends.callback(server.close)
            return session, urlsplit(server.url)

        yield make


def connected(link, text=""):
    line = socket.create_connection((link.hostname, link.port), timeout=PATIENCE)
    line.sendall(text.encode())
    return line


def request(link, path=None, more=""):
    return f"GET {link.path if path is None else path} HTTP/1.1\r\nHost: {link.netloc}\r\n{more}\r\n"


def seconds_until_closed(line):
    """Return how long the other side keeps a connection."""
    began = time.monotonic()
    with contextlib.suppress(ConnectionError):
        while line.recv(1 << 16):
            pass
    return time.monotonic() - began


def wait_until(holds):
    """Return when something holds."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def status(link, path=None):
    line = http.client.HTTPConnection(link.hostname, link.port, timeout=PATIENCE)
    try:
        line.request("GET", link.path if path is None else path)
        return line.getresponse().status
    finally:
        line.close()


def test_connections_without_a_whole_request_end(served):
    _, link = served(patience=0.3)
    for text in (
        "",
        "G",
        request(link)[:-2],
        request(link, "/wrong/")[:-2],
        "POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\n",
    ):
        with connected(link, text) as line:
            assert seconds_until_closed(line) < 5.0, text


def test_headers_that_trickle_end(served):
    _, link = served(patience=0.3)
    began = time.monotonic()
    with connected(link, request(link)[:-2]) as line, pytest.raises(OSError):
        while time.monotonic() < began + 10.0:
            line.sendall(b"X: y\r\n")
            time.sleep(0.02)
    assert time.monotonic() < began + 5.0


def test_idle_connections_end(served):
    _, link = served(patience=0.3)
    with connected(link, request(link)) as line:
        assert line.recv(12) == b"HTTP/1.1 200"
        assert seconds_until_closed(line) < 5.0


def test_strangers_give_way_to_the_next_and_to_those_with_the_link(served):
    session, link = served(strangers=8)
    with contextlib.ExitStack() as ends:
        lines = [ends.enter_context(connected(link)) for _ in range(30)]
        # The page gets in beside them, and stays.
        page = ends.enter_context(connected(link, request(link)))
        assert page.recv(12) == b"HTTP/1.1 200"
        lines += [ends.enter_context(connected(link)) for _ in range(30)]
        assert status(link) == 200 and status(link, "/wrong/") == 404
        page.settimeout(0.1)
        with contextlib.suppress(TimeoutError):
            while page.recv(1 << 16):
                pass
        page.settimeout(PATIENCE)
        page.sendall(request(link, link.path + "viewer.css").encode())
        assert page.recv(12) == b"HTTP/1.1 200"
        ended = []
        for line in lines:
            line.settimeout(0.01)
            try:
                ended.append(line.recv(1) == b"")
            except ConnectionError:
                ended.append(True)
            except TimeoutError:
                ended.append(False)
        # The newest are there; those that showed a wrong link, or the right one, took the place of one each.
        assert all(ended[:50]) and 6 <= ended.count(False) <= 8


def test_a_page_that_answers_no_heartbeat_is_forgotten(served):
    session, link = served(heartbeat=0.2)
    key = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    upgrade = f"Connection: Upgrade\r\nUpgrade: websocket\r\nOrigin: http://{link.netloc}\r\n{key}"
    with connected(link, request(link, link.path + "socket", upgrade)) as line:
        assert line.recv(12) == b"HTTP/1.1 101"
        wait_until(lambda: session._clients)
        assert seconds_until_closed(line) < 5.0
    wait_until(lambda: not session._clients)


WITHOUT_DESCRIPTORS = """
import logging, os, resource, sheetsplat as ss, numpy as np
logging.basicConfig(format="%(message)s")
with ss.view(np.eye(4)[None] * np.ones((4, 1, 1)), browser=False, backend="cpu", threads=1) as viewer:
    print(viewer.url, flush=True)
    input()
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    held = []
    try:
        while True:
            held.append(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        print("none", flush=True)
    input()
    for one in held:
        os.close(one)
    input()
"""


@pytest.mark.skipif(os.name == "nt", reason="there is no such limit")
def test_without_descriptors_the_server_says_so_once_and_goes_on_when_there_are_some():
    command = [sys.executable, "-c", WITHOUT_DESCRIPTORS]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as child:

        def go_on():
            child.stdin.write("\n")
            child.stdin.flush()

        link = urlsplit(child.stdout.readline().strip())
        assert status(link) == 200
        go_on()
        assert child.stdout.readline() == "none\n"
        with contextlib.ExitStack() as ends:
            lines = [ends.enter_context(connected(link, request(link))) for _ in range(5)]
            time.sleep(1.2)
            go_on()
            assert [line.recv(12) for line in lines] == [b"HTTP/1.1 200"] * 5
        assert status(link) == 200
        go_on()
        _, told = child.communicate(timeout=PATIENCE)
    assert told.count("\n") == 1 and told.startswith("the viewer cannot take connections and tries again: "), told


class Notebook:
    """Places of a widget, with a short beat, and what they were sent."""

    def __init__(self, beat=0.02):
        self.session = Session(Shown(VALUES, {"backend": "cpu", "threads": 1}, None, None))
        self.sent = []
        self.places = Places(self.session, lambda message, _: self.sent.append(message), beat)

    def say(self, kind, place="a", **parts):
        self.places.received(None, {"type": kind, "place": place, **parts}, [])

    def hello(self, place="a"):
        self.say("hello", place, width=16, height=16)

    def told(self, place):
        return [one["type"] for one in self.sent if one["place"] == place]

    async def forgets(self):
        end = time.monotonic() + PATIENCE
        while self.session._clients and time.monotonic() < end:
            await asyncio.sleep(0.01)
        return not self.session._clients


@pytest.fixture
def notebook():
    made = Notebook()
    yield made
    made.session.close()


def test_a_place_that_says_nothing_is_forgotten_and_may_come_again(notebook):
    async def run():
        notebook.hello()
        assert notebook.session._clients and await notebook.forgets()
        notebook.say("alive")
        assert notebook.told("a")[-1] == "forgotten" and not notebook.session._clients
        notebook.hello()
        assert notebook.session._clients and await notebook.forgets()

    asyncio.run(run())


def test_a_place_that_says_that_it_is_there_stays(notebook):
    async def run():
        notebook.hello()
        notebook.hello("gone")
        for _ in range(20):
            notebook.say("alive")
            await asyncio.sleep(0.02)
        assert len(notebook.session._clients) == 1 and "forgotten" not in notebook.told("a")

    asyncio.run(run())


def test_while_a_cell_runs_no_place_is_forgotten(notebook):
    async def run():
        notebook.hello()
        await asyncio.sleep(0.03)
        # Nothing that places say is heard meanwhile.
        time.sleep(0.5)
        notebook.say("alive")
        assert notebook.session._clients and "forgotten" not in notebook.told("a")

    asyncio.run(run())


def test_places_of_pages_that_are_gone_are_free_for_others(notebook):
    async def run():
        for number in range(40):
            notebook.hello(str(number))
        assert len(notebook.session._clients) == 32 and "hello" not in notebook.told("39")
        assert await notebook.forgets()
        notebook.say("alive", "39")
        notebook.hello("39")
        assert notebook.told("39")[:2] == ["forgotten", "hello"]

    asyncio.run(run())
