"""A client of websockets (RFC 6455) that does whatever it is told, right or wrong."""

from __future__ import annotations

import base64
import os
import socket
import struct
from urllib.parse import urlsplit

TEXT, BINARY, CLOSE, PING, PONG = 0x1, 0x2, 0x8, 0x9, 0xA
_PATIENCE = 20.0


def frame(
    payload: bytes,
    opcode: int = TEXT,
    *,
    fin: bool = True,
    masked: bool = True,
    reserved: int = 0,
    stated: int | None = None,
    wide: int = 0,
) -> bytes:
    """Return a frame.

    Parameters
    ----------
    payload
        Its bytes.
    opcode
        What it is.
    fin, masked, reserved
        The bits of its head; pages mask.
    stated
        The length that its head says; that of the payload unless given.
    wide
        Bytes of the length, 2 or 8, where fewer would do.
    """
    length = len(payload) if stated is None else stated
    head = bytes([fin << 7 | (reserved & 7) << 4 | opcode & 15])
    bit = masked << 7
    if length < 126 and not wide:
        head += bytes([bit | length])
    elif length < 1 << 16 and wide != 8:
        head += bytes([bit | 126]) + struct.pack(">H", length)
    else:
        head += bytes([bit | 127]) + struct.pack(">Q", length & (1 << 64) - 1)
    if not masked:
        return head + payload
    key = os.urandom(4)
    long = (key * (len(payload) // 4 + 1))[: len(payload)]
    mixed = int.from_bytes(payload, "big") ^ int.from_bytes(long, "big")
    return head + key + mixed.to_bytes(len(payload), "big")


class Line:
    """A socket to a viewer's server; a `with` block closes it.

    Parameters
    ----------
    url
        The page's link.
    receive_bytes
        Of the kernel's buffer for what is not read; None: as the system has it.
    """

    def __init__(self, url: str, receive_bytes: int | None = None) -> None:
        self.link = urlsplit(url)
        assert self.link.hostname is not None and self.link.port is not None
        self.socket = socket.socket()
        if receive_bytes is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        self.socket.settimeout(_PATIENCE)
        self.socket.connect((self.link.hostname, self.link.port))
        self._read = b""

    def __enter__(self) -> Line:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.socket.close()

    def send(self, data: bytes) -> None:
        """Send bytes as they are."""
        self.socket.sendall(data)

    def request(self, path: str | None = None, **headers: str | None) -> None:
        """Ask for a websocket; headers that are None are left out."""
        said: dict[str, str | None] = {
            "Host": self.link.netloc,
            "Origin": f"http://{self.link.netloc}",
            "Upgrade": "websocket",
            "Connection": "Upgrade",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
        }
        said |= {name.replace("_", "-"): value for name, value in headers.items()}
        lines = [f"GET {self.link.path + 'socket' if path is None else path} HTTP/1.1"]
        lines += [f"{name}: {value}" for name, value in said.items() if value is not None]
        self.send("\r\n".join([*lines, "", ""]).encode("latin-1"))

    def answer(self) -> int:
        """Return the status of the server's answer; 0 where it closed the line."""
        while b"\r\n\r\n" not in self._read:
            piece = self.socket.recv(65536)
            if not piece:
                return 0
            self._read += piece
        head, _, self._read = self._read.partition(b"\r\n\r\n")
        return int(head.split()[1])

    def open(self) -> Line:
        """Shake hands as a page does."""
        self.request()
        assert self.answer() == 101
        return self

    def receive(self) -> tuple[int, bytes]:
        """Return opcode and payload of the next frame; ConnectionError where the server closed the line."""
        first, second = self._take(2)
        length = second & 127
        if length >= 126:
            length = int.from_bytes(self._take(2 if length == 126 else 8), "big")
        return first & 15, self._take(length)

    def _take(self, count: int) -> bytes:
        while len(self._read) < count:
            piece = self.socket.recv(1 << 20)
            if not piece:
                raise ConnectionError("the server closed the line")
            self._read += piece
        found, self._read = self._read[:count], self._read[count:]
        return found
