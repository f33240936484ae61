"""Who gets something from the viewer's server, and who gets nothing: token, names, origins, messages."""

from __future__ import annotations

import asyncio
import hmac
import http.client
import json
import socket
import struct
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.viewer import protocol, server

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed")

VALUES = np.random.default_rng(1).random((6, 6, 6)).astype(np.float32)


@pytest.fixture(scope="module")
def viewer():
    with ss.view(VALUES, browser=False, backend="cpu", threads=1) as made:
        yield made


@pytest.fixture
def link(viewer):
    return urlsplit(viewer.url)


def answer(link, path, *, method="GET", host=None, **headers):
    """Return status and body of a request; `host`: what the header Host says, None: the right one."""
    line = http.client.HTTPConnection(link.hostname, link.port, timeout=20)
    try:
        line.putrequest(method, path, skip_host=True)
        line.putheader("Host", link.netloc if host is None else host)
        for name, value in headers.items():
            line.putheader(name, value)
        line.endheaders()
        found = line.getresponse()
        return found.status, found.read(), dict(found.getheaders())
    finally:
        line.close()


def test_the_token_has_128_random_bits(viewer, link):
    import base64

    token = link.path.strip("/")
    assert len(base64.urlsafe_b64decode(token + "==")) == 16
    with ss.view(VALUES, browser=False, backend="cpu") as other:
        assert urlsplit(other.url).path != link.path
    assert link.hostname == "127.0.0.1" and token not in repr(viewer)


@pytest.mark.parametrize("name", ["", "viewer.js", "viewer.css"])
def test_files_of_the_page_are_served(link, name):
    status, body, headers = answer(link, link.path + name)
    assert status == 200 and len(body) > 300
    assert "script-src 'self'" in headers["Content-Security-Policy"] and "'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer" and headers["X-Content-Type-Options"] == "nosniff"


def test_without_the_token_there_is_nothing(link):
    token = link.path.strip("/")
    wrong = "A" + token[1:] if token[0] != "A" else "B" + token[1:]
    for path in (
        "/",
        "//",
        "/viewer.js",
        "/socket",
        f"/{wrong}/",
        f"/{wrong}/socket",
        f"/{token[:-1]}/",
        f"/{token}x/",
    ):
        assert answer(link, path)[:2] == (404, b""), path
    assert answer(link, "/%ff%00/")[:2] == (404, b"")
    assert answer(link, f"/?token={token}")[:2] == (404, b"")


def test_the_token_is_compared_in_constant_time(link, monkeypatch):
    compared = []

    def compare(first, second):
        compared.append((first, second))
        return hmac.compare_digest(first, second)

    class Watched:
        compare_digest = staticmethod(compare)

    monkeypatch.setattr(server, "hmac", Watched)
    answer(link, "/wrong/")
    answer(link, link.path)
    assert [first for first, _ in compared] == [b"wrong", link.path.strip("/").encode()]


def test_no_other_file_is_served_and_none_is_written(link, tmp_path):
    for name in (
        "index.html",
        "page.js",
        "files.py",
        "../viewer.py",
        "..%2fviewer.py",
        "%2e%2e/viewer.py",
        "/etc/passwd",
        "socket/x",
    ):
        assert answer(link, link.path + name)[:2] == (404, b""), name
    for method in ("POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH"):
        assert answer(link, link.path, method=method)[:2] == (404, b""), method


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "evil.example:80", "", "192.168.0.9", "[::2]"]
)
def test_names_that_lead_here_are_refused(link, host):
    assert answer(link, link.path, host=host)[:2] == (404, b"")


def test_names_of_this_machine_are_taken(link):
    for host in (f"localhost:{link.port}", f"127.0.0.1:{link.port}", "[::1]:9000", "localhost"):
        assert answer(link, link.path, host=host)[0] == 200, host


def test_other_origins_are_refused(link):
    for origin in ("http://evil.example", "null", f"https://{link.netloc}", "http://127.0.0.1:1", ""):
        assert answer(link, link.path, Origin=origin)[:2] == (404, b""), origin
    assert answer(link, link.path, Origin=f"http://{link.netloc}")[0] == 200


async def talk(address, messages, *, origin, host=None, wanted=lambda found: False, seconds=20.0):
    """Return what the websocket answers to messages, until something wanted came or it was closed."""
    headers = {} if origin is None else {"Origin": origin}
    headers |= {} if host is None else {"Host": host}
    found = []
    async with aiohttp.ClientSession() as session, session.ws_connect(address, headers=headers, max_msg_size=0) as line:
        for message in messages:
            await line.send_str(message if isinstance(message, str) else json.dumps(message))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            got = await line.receive(timeout=max(0.1, end - time.monotonic()))
            if got.type is aiohttp.WSMsgType.TEXT:
                found.append(json.loads(got.data))
            elif got.type is aiohttp.WSMsgType.BINARY:
                size = struct.unpack("<I", got.data[:4])[0]
                found.append(json.loads(got.data[4 : 4 + size]))
            else:
                return found, line.close_code
            if wanted(found[-1]):
                break
        return found, None


HELLO = {"type": "hello", "width": 32, "height": 32}


def socket_of(link, token=None):
    return f"http://{link.netloc}/{token or link.path.strip('/')}/socket"


def last(message):
    return message["type"] == "frame" and message["last"]


def test_the_socket_talks_to_its_own_page(link):
    found, _ = asyncio.run(talk(socket_of(link), [HELLO], origin=f"http://{link.netloc}", wanted=last))
    assert {"hello", "state", "frame"} <= {one["type"] for one in found}


@pytest.mark.parametrize("case", ["token", "origin", "no origin", "host"])
def test_the_socket_says_nothing_to_others(link, case):
    origin = {"origin": "http://evil.example", "no origin": None}.get(case, f"http://{link.netloc}")
    token, host = ("A" * 22 if case == "token" else None), ("evil.example" if case == "host" else None)
    if host:
        origin = "http://evil.example"
    with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
        asyncio.run(talk(socket_of(link, token), [HELLO], origin=origin, host=host))
    assert caught.value.status == 404


def test_messages_that_are_not_known_are_dropped_and_the_line_stays(link):
    bad = [
        "",
        "{",
        "[]",
        '{"type": "open", "path": "/etc/passwd"}',
        '{"type": "save", "width": 5, "height": 5, "path": "/tmp/x"}',
    ]
    found, code = asyncio.run(talk(socket_of(link), [*bad, HELLO], origin=f"http://{link.netloc}", wanted=last))
    assert code is None and found[-1]["type"] == "frame"


def test_messages_that_are_too_long_end_the_line(link):
    long = json.dumps({"type": "set", "changes": {"mode": "x" * protocol.LONGEST}})
    found, code = asyncio.run(talk(socket_of(link), [long], origin=f"http://{link.netloc}"))
    assert code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
    # What the page before has asked for may still be told to all.
    assert {one["type"] for one in found} <= {"about", "frame"}
    # Others go on.
    test_the_socket_talks_to_its_own_page(link)


def test_a_closed_viewer_serves_nothing():
    with ss.view(VALUES, browser=False, backend="cpu") as viewer:
        link = urlsplit(viewer.url)
    with pytest.raises(OSError), socket.create_connection((link.hostname, link.port), timeout=5):
        pass


def test_a_port_that_is_taken_is_told(link):
    with ss.view(VALUES, browser=False, backend="cpu", port=link.port) as viewer:
        with pytest.raises(ss.Error, match=f"port {link.port}"):
            assert viewer.url


def test_all_addresses_take_numbers_and_no_names():
    with ss.view(VALUES, browser=False, backend="cpu", host="0.0.0.0") as viewer:
        link = urlsplit(viewer.url)
        assert answer(link, link.path, host="192.168.0.9:8000")[0] == 200
        assert answer(link, link.path, host="evil.example")[:2] == (404, b"")
    assert server.is_loopback("127.0.0.1") and server.is_loopback("::1") and server.is_loopback("localhost")
    assert not server.is_loopback("0.0.0.0") and not server.is_loopback("example.org")


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_command_says_what_all_addresses_mean(tmp_path, monkeypatch, host):
    np.save(tmp_path / "a.npy", VALUES)
    monkeypatch.setattr(ss.Viewer, "wait", lambda self: None)
    told = run("view", tmp_path / "a.npy", "--host", host, "--no-browser", "--backend", "cpu").output
    assert "http://127.0.0.1:" in told
    meant = "warning: the page is served at 0.0.0.0: everybody who can reach this machine and knows the link sees"
    assert (meant in told) == (host == "0.0.0.0")


@pytest.mark.parametrize("place", ["open_browser", "wait"])
def test_ctrl_c_ends_the_command_wherever_it_is(tmp_path, monkeypatch, place):
    def interrupted(_):
        raise KeyboardInterrupt

    np.save(tmp_path / "a.npy", VALUES)
    monkeypatch.setattr(ss.Viewer, "open_browser", lambda self: True)
    monkeypatch.setattr(ss.Viewer, place, interrupted)
    assert "Aborted" not in run("view", tmp_path / "a.npy", "--backend", "cpu").output
