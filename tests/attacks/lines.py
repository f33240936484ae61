"""Lines to the viewer's server that no browser would make: requests, frames, readers that do not read, many at once."""

from __future__ import annotations

import gc
import json
import random
import resource
import socket
import struct
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

import sheetsplat as ss
from attacks import Tally
from attacks.messages import Faults, hostile, volumes
from attacks.websocket import BINARY, CLOSE, PING, PONG, TEXT, Line, frame
from sheetsplat.viewer.server import Server

HELLO = json.dumps({"type": "hello", "width": 32, "height": 24}).encode()
# What others may have left is a scene that cannot be drawn.
_AFRESH = json.dumps({"type": "set", "changes": {"automatic": True, "mode": "composite", "quality": "good"}}).encode()
# A page that works is looked for after so many lines that do not.
_ALIVE = 25
# Lines that stay open, without ever saying a word more.
_HELD = 12
_SECONDS = 20.0


def viewer(data: Any = None, **options: Any) -> ss.Viewer:
    """Return a viewer of a small volume."""
    shown = volumes()["first"] if data is None and "choices" not in options else data
    return ss.view(shown, browser=False, backend="cpu", threads=1, **options)


def gets_a_picture(url: str) -> bool:
    """Return whether a page that does all right is sent a complete picture."""
    with Line(url) as line:
        line.request()
        if line.answer() != 101:
            return False
        line.send(frame(HELLO) + frame(_AFRESH))
        end = time.monotonic() + _SECONDS
        while time.monotonic() < end:
            kind, payload = line.receive()
            if kind == BINARY:
                size = struct.unpack("<I", payload[:4])[0]
                told = json.loads(payload[4 : 4 + size])
                if told["type"] == "frame" and told["last"]:
                    return True
                line.send(frame(b'{"type": "drawn", "number": 1}'))
    return False


def _no_request(line: Line, rng: random.Random) -> None:
    line.send(rng.randbytes(rng.choice((1, 10, 1000, 20000))))


def _odd_request(line: Line, rng: random.Random) -> None:
    token = line.link.path.strip("/")
    path = rng.choice(
        ("*", "/", "", f"/{token}", f"//{token}/", f"/{token}/../x", f"/{token}/%2e%2e/%2e%2e/etc/passwd", "/%",
         "/%ff%fe/", f"http://evil.example/{token}/", f"http://{line.link.netloc}/{token}/viewer.js",
         f"/{token}/viewer.js?x=%00", "/" * 9000,
         f"/{token}/socket", f"/{token}/socket/", f"/{token}\\..\\x", "/\x7f", f"/{token}/" + "a/" * 500, token)
    )  # fmt: skip
    method = rng.choice(("GET", "GET", "GET", "HEAD", "POST", "CONNECT", "OPTIONS", "PUT", "get", "G" * 9000, "TRACE"))
    host = rng.choice(
        (line.link.netloc, "evil.example", "", "127.0.0.1", "127.0.0.1:x", "[::1", "localhost:99999999", "\xff",
         "a" * 9000)
    )  # fmt: skip
    version = rng.choice(("HTTP/1.1", "HTTP/1.1", "HTTP/1.0", "HTTP/0.9", "HTTP/9.9", ""))
    lines = [f"{method} {path} {version}", f"Host: {host}"]
    if rng.random() < 0.2:
        lines.pop()
    if rng.random() < 0.2:
        lines.append(f"Host: {rng.choice((host, 'evil.example'))}")
    lines += [f"x-{n}: {'y' * rng.choice((1, 100, 9000))}" for n in range(rng.choice((0, 0, 3, 200)))]
    body = rng.choice(
        ("", "Content-Length: 5", "Content-Length: -1", "Transfer-Encoding: chunked", f"Content-Length: {10**18}")
    )
    line.send(
        "\r\n".join([*lines, *([body] if body else []), "", rng.choice(("", "hello", "5\r\nhello"))]).encode("latin-1")
    )


def _wrong_handshake(line: Line, rng: random.Random) -> None:
    changed: dict[str, Any] = rng.choice(
        ({"Sec_WebSocket_Key": None}, {"Sec_WebSocket_Key": "x"}, {"Sec_WebSocket_Version": "99"}, {"Upgrade": "h2c"},
         {"Connection": "close"}, {"Upgrade": None}, {"Sec_WebSocket_Version": None},
         {"Sec_WebSocket_Extensions": "permessage-deflate; client_max_window_bits=99"},
         {"Sec_WebSocket_Protocol": "a, b"}, {"Content_Length": "7"})
    )  # fmt: skip
    line.request(**changed)
    line.answer()


def _unmasked(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO, masked=False))


def _reserved(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO, reserved=rng.randrange(1, 8)))


def _unknown_opcode(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO, rng.choice((3, 4, 5, 6, 7, 11, 12, 13, 14, 15))))


def _wrong_length(line: Line, rng: random.Random) -> None:
    stated = rng.choice((len(HELLO) + 1, 1000, 1 << 17, 1 << 31, 1 << 62, (1 << 64) - 1))
    line.open().send(frame(HELLO, stated=stated))
    line.send(bytes(rng.choice((0, 10, 100000))))


def _wide_length(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO, wide=rng.choice((2, 8))))


def _fragments(line: Line, rng: random.Random) -> None:
    line.open()
    for _ in range(rng.randrange(1, 40)):
        opcode = rng.choice((0, 0, 0, TEXT, BINARY, PING, PONG))
        line.send(frame(rng.randbytes(rng.choice((0, 1, 100, 5000))), opcode, fin=rng.random() < 0.3))


def _endless_fragments(line: Line, rng: random.Random) -> None:
    line.open().send(frame(b"[", fin=False))
    for _ in range(rng.choice((10, 100, 400))):
        line.send(frame(b"1," * 500, 0, fin=False))


def _no_utf8(line: Line, rng: random.Random) -> None:
    line.open().send(frame(rng.choice((b"\xff\xfe", b"\xc0\x80", b"\xed\xa0\x80", b"\xf8" * 50))))


def _binary(line: Line, rng: random.Random) -> None:
    line.open().send(frame(rng.randbytes(1000), BINARY))
    line.send(frame(HELLO, BINARY))


def _control(line: Line, rng: random.Random) -> None:
    opcode = rng.choice((PING, PONG, CLOSE))
    line.open().send(frame(rng.randbytes(rng.choice((0, 1, 125, 126, 4000))), opcode, fin=rng.random() < 0.7))


def _wrong_close(line: Line, rng: random.Random) -> None:
    code = rng.choice((0, 999, 1000, 1004, 1005, 1006, 1015, 2999, 5000, 65535))
    line.open().send(
        frame(rng.choice((b"", b"\x03", struct.pack(">H", code), struct.pack(">H", code) + b"\xff" * 9)), CLOSE)
    )
    line.send(frame(HELLO))


def _pings(line: Line, rng: random.Random) -> None:
    line.open().send(b"".join(frame(b"x" * 100, PING) for _ in range(rng.choice((10, 2000)))))


def _moves(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO))
    camera = {"kind": "perspective", "eye": [40, 7, 9], "target": [7, 7, 7], "up": [0, 0, 1], "fov_y": 35}
    made = []
    for _ in range(rng.choice((50, 1000))):
        camera["eye"] = [rng.uniform(-60, 60) for _ in range(3)]
        made.append(frame(json.dumps({"type": "set", "changes": {"camera": camera}}).encode()))
    line.send(b"".join(made))


def _half_open(line: Line, rng: random.Random) -> None:
    if rng.random() < 0.7:
        line.open().send(frame(HELLO))
    else:
        line.request()
    line.socket.shutdown(socket.SHUT_WR)


def _reset(line: Line, rng: random.Random) -> None:
    line.open().send(frame(HELLO))
    line.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def _early(line: Line, rng: random.Random) -> None:
    line.request()
    line.send(frame(HELLO) + frame(json.dumps({"type": "save", "width": 9, "height": 9}).encode()))


def _partly(line: Line, rng: random.Random) -> None:
    if rng.random() < 0.5:
        line.send(b"GET /")
    else:
        line.open().send(frame(HELLO)[: rng.randrange(1, 9)])


def _hostile_text(line: Line, rng: random.Random) -> None:
    line.open()
    for _ in range(rng.choice((1, 30))):
        text = hostile(rng)
        data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
        cut = rng.randrange(len(data) + 1)
        line.send(frame(data[:cut], fin=False) + frame(data[cut:], 0) if rng.random() < 0.3 else frame(data))


KINDS: dict[str, Callable[[Line, random.Random], None]] = {
    one.__name__[1:]: one
    for one in (
        _no_request, _odd_request, _wrong_handshake, _unmasked, _reserved, _unknown_opcode, _wrong_length,
        _wide_length, _fragments, _endless_fragments, _no_utf8, _binary, _control, _wrong_close, _pings, _moves,
        _half_open, _reset, _early, _partly, _hostile_text,
    )
}  # fmt: skip


def lines(seed: int, count: int) -> Tally:
    """Make lines that do something wrong, some of which stay open; pages that do all right get their pictures."""
    tally, rng = Tally(), random.Random(seed)
    held: list[Line] = []
    with Faults() as faults, viewer() as shown:
        url = shown.url
        for number in range(count):
            name = rng.choice(sorted(KINDS))
            line = Line(url)
            try:
                KINDS[name](line, rng)
                line.socket.settimeout(0.02)
                line.socket.recv(4096)
            except (OSError, AssertionError):
                # The server may close the line, or say nothing.
                tally.did("lines that were closed or not answered")
            tally.did("lines")
            tally.did(f"lines: {name}")
            held.append(line)
            if len(held) > _HELD:
                held.pop(rng.randrange(len(held))).socket.close()
            for fault in faults.taken():
                tally.failed(f"{name} (line {number}): {fault[-3000:]}")
            if number % _ALIVE == _ALIVE - 1 or number == count - 1:
                for one in held:
                    one.socket.close()
                held.clear()
                _until_few_pages(shown, 0)
                try:
                    fine = gets_a_picture(url)
                except OSError as error:
                    fine = False
                    tally.failed(f"{type(error).__name__}: {error}\n{stacks()}")
                tally.did("pages that got a picture", fine)
                if not fine:
                    tally.failed(f"no picture after line {number}, {name}")
                    break
        if not _until_few_pages(shown, 0):
            tally.failed(f"{shown._server._pages} pages although all lines are closed")  # type: ignore[union-attr]
    return tally


def _until_few_pages(shown: ss.Viewer, most: int) -> bool:
    """Wait until the server has at most so many pages; return whether it has."""
    end = time.monotonic() + _SECONDS
    while time.monotonic() < end:
        server = shown._server
        if server is None or server._pages <= most:
            return True
        time.sleep(0.01)
    return False


def stacks() -> str:
    """Return what all threads do."""
    names = {one.ident: one.name for one in threading.enumerate()}
    return "\n".join(
        f"{names.get(ident)}:\n" + "".join(traceback.format_stack(top)[-8:])
        for ident, top in sys._current_frames().items()
    )


def many_pages(seed: int, count: int) -> Tally:
    """Open many pages at the same moment: as many as there may be get pictures, the rest are refused."""
    tally, rng = Tally(), random.Random(seed)
    with Faults() as faults, viewer() as shown:
        url = shown.url
        start, answered = threading.Barrier(count), threading.Barrier(count)
        found, lock = [], threading.Lock()

        def page(pause: float) -> None:
            with Line(url) as line:
                start.wait()
                time.sleep(pause)
                line.request()
                status = line.answer()
                with lock:
                    found.append(status)
                # A page that left before all were answered would let in one more.
                answered.wait(3 * _SECONDS)
                if status == 101:
                    line.send(frame(HELLO))
                    end = time.monotonic() + 3 * _SECONDS
                    while time.monotonic() < end:
                        kind, payload = line.receive()
                        if kind == BINARY and b'"type": "frame"' in payload[:200]:
                            with lock:
                                found.append(1)
                            return

        threads = [threading.Thread(target=page, args=(rng.uniform(0, 0.01),)) for _ in range(count)]
        for one in threads:
            one.start()
        for one in threads:
            one.join()
        tally.did("pages", found.count(101))
        tally.did("pages that were refused", found.count(404))
        tally.did("pages that got a picture", found.count(1))
        if found.count(1) != found.count(101) or found.count(101) + found.count(404) != count:
            tally.failed(f"answers {sorted(found)}")
        if not _until_few_pages(shown, 0) or not gets_a_picture(url):
            tally.failed("no page can be opened after them")
        for fault in faults.taken():
            tally.failed(fault[-3000:])
    return tally


def memory() -> int:
    """Return the bytes of this process in memory."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


class _Flood:
    """A session that sends each page as many megabytes as it is told, and then a small message.

    Parameters
    ----------
    kind, count
        Type and number of the messages.
    """

    def __init__(self, kind: str, count: int) -> None:
        self._kind, self._count = kind, count
        self.sent = 0

    def connect(self, deliver: Callable[[dict[str, Any], bytes], None]) -> object:
        """Begin to send."""

        def send() -> None:
            for number in range(self._count):
                deliver({"type": self._kind, "number": number}, bytes(1 << 20))
                self.sent += 1
                # What takes messages has a turn.
                time.sleep(0.0005)
            deliver({"type": "end"}, b"")

        threading.Thread(target=send, daemon=True).start()
        return object()

    def disconnect(self, client: object) -> None:
        """Do nothing."""


# Bytes that a reader who takes nothing may cost: what may wait for it, one message more, and what two libraries keep.
_MOST_MEMORY = 60e6


def slow_readers(seed: int, count: int) -> Tally:
    """Send megabytes to a page that does not read: memory stays bounded, and the newest frame comes when it does."""
    tally, rng = Tally(), random.Random(seed)
    for kind in ("frame", "file"):
        with Faults() as faults:
            session = _Flood(kind, count)
            server = Server(session)  # type: ignore[arg-type]
            try:
                before = memory()
                line = Line(server.url, 4096).open()
                end = time.monotonic() + _SECONDS + count / 100
                while session.sent < count and time.monotonic() < end:
                    time.sleep(0.01)
                more = memory() - before
                tally.did(f"megabytes of {kind}s that nobody reads", count)
                tally.did(f"MB more for {kind}s", more // 10**6)
                if more > _MOST_MEMORY or session.sent < count:
                    tally.failed(f"{more / 1e6:.0f} MB more for {session.sent} of {count} {kind}s")
                time.sleep(rng.uniform(0, 0.2))
                numbers, ended = _rest_of(line)
                if kind == "frame" and not (ended and len(numbers) < count and numbers[-1:] == [count - 1]):
                    tally.failed(f"frames {numbers} of {count}, all of it: {ended}")
                if kind == "file" and ended:
                    tally.failed(f"a reader of {len(numbers)} of {count} files was not given up")
                line.socket.close()
            finally:
                server.close()
            for fault in faults.taken():
                tally.failed(fault[-3000:])
    return tally


def _rest_of(line: Line) -> tuple[list[int], bool]:
    """Return the numbers of all messages that come, and whether the last one came."""
    numbers: list[int] = []
    try:
        while True:
            opcode, payload = line.receive()
            if opcode == TEXT:
                return numbers, True
            if opcode == BINARY:
                numbers.append(json.loads(payload[4 : 4 + struct.unpack("<I", payload[:4])[0]])["number"])
    except OSError:
        return numbers, False
