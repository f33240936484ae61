"""The server of a viewer's page, on this machine alone unless told otherwise. Needs aiohttp.

Whoever knows the link, whose path holds 128 random bits, sees the data and may change the picture; nobody else gets
anything. A page of another origin, and a name that leads to this machine, are refused as well, so that neither a page
of the web nor a changed DNS entry gets through a browser. Files of the package are served, and no others; none is
written.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import logging
import os
import secrets
import socket
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sheetsplat.errors import Error, complain, missing_package
from sheetsplat.viewer.client import Client
from sheetsplat.viewer.connections import Limits, Strangers, accept
from sheetsplat.viewer.page import files
from sheetsplat.viewer.protocol import LONGEST, packed
from sheetsplat.viewer.session import Session

if TYPE_CHECKING:
    from aiohttp import web

_TOKEN_BYTES = 16
# Leads from a file to the page.
_REDIRECTION = """<!doctype html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0;url={url}">
<title>sheetsplat</title>
<a href="{url}">The page of the viewer</a>
"""
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
# Bytes, and messages, that wait for a page which does not take them; a page that is so far behind is gone.
_MOST_BYTES, _MOST_WAITING = 1 << 24, 2000
_MOST_PAGES = 32
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine as only itself can reach it."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address."""
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listener = socket.socket(family, kind, protocol)
    try:
        # The port can be taken again at once after the viewer before has ended.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen()
        listener.setblocking(False)
    except BaseException:
        listener.close()
        raise
    return listener


def _is_fault(record: logging.LogRecord) -> bool:
    """Return whether what aiohttp logs is more than a request that is none."""
    from aiohttp.http_exceptions import HttpProcessingError

    return record.exc_info is None or not isinstance(record.exc_info[1], HttpProcessingError | ConnectionError)


def _http_log() -> logging.Logger:
    """Return where aiohttp logs: to a program that scans ports, nothing is wrong here."""
    log = logging.getLogger("sheetsplat.viewer.http")
    if _is_fault not in log.filters:
        log.addFilter(_is_fault)
    return log


class _Outbox:
    """What a page is still to be sent, in its order. Of frames the newest alone waits.

    Parameters
    ----------
    lost
        Called once, where more waits than a page that lives would leave.
    """

    def __init__(self, lost: Callable[[], object]) -> None:
        self._lost, self._is_lost = lost, False
        self._waiting: deque[tuple[bytes | str, bool]] = deque()
        self._size = 0
        self._news = asyncio.Event()

    def put(self, data: bytes | str, *, is_frame: bool) -> None:
        """Add a message; a frame takes the place of one that waits."""
        if self._is_lost:
            return
        if is_frame:
            self._drop([one for one in self._waiting if one[1]])
        # One message alone may be larger than all others together: a film.
        if self._waiting and (len(self._waiting) >= _MOST_WAITING or self._size > _MOST_BYTES):
            self._is_lost = True
            self._drop(list(self._waiting))
            self._lost()
            return
        self._waiting.append((data, is_frame))
        self._size += len(data)
        self._news.set()

    def _drop(self, messages: list[tuple[bytes | str, bool]]) -> None:
        for one in messages:
            self._waiting.remove(one)
            self._size -= len(one[0])

    async def next(self) -> bytes | str:
        """Return the next message, as soon as there is one."""
        while not self._waiting:
            self._news.clear()
            await self._news.wait()
        data, _ = self._waiting.popleft()
        self._size -= len(data)
        return data


class Server:
    """Serves the page of a session, in a thread of its own.

    Parameters
    ----------
    session
        What the page shows.
    host
        Address to listen at.
    port
        Port to listen at; 0: any free one.
    limits
        What it grants to connections; the usual unless given.

    Raises
    ------
    Unsupported
        Where aiohttp is not installed; it comes with ``pip install "sheetsplat[view]"``.
    Error
        Where the address cannot be listened at.
    """

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 0, limits: Limits | None = None) -> None:
        try:
            import aiohttp  # noqa: F401
        except ImportError as error:
            raise missing_package("the viewer's page cannot be served", error) from None
        self._session, self._host, self._limits = session, host, limits or Limits()
        self._strangers = Strangers(self._limits)
        self._token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._pages = 0
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._loop = asyncio.new_event_loop()
        started: Future[int] = Future()
        self._ended: asyncio.Event | None = None
        self._thread = threading.Thread(
            target=self._run, args=(port, started), name="sheetsplat-viewer-server", daemon=True
        )
        self._thread.start()
        try:
            self.port = started.result()
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            advice = "another port, or none for any that is free"
            raise complain(f"the viewer cannot listen at {host}, port {port}", reason, "", advice, kind=Error) from None

    @property
    def url(self) -> str:
        """The link of the page; whoever knows it sees the data."""
        anywhere = self._host in ("0.0.0.0", "::", "")
        host = "127.0.0.1" if anywhere else f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self.port}/{self._token}/"

    def redirection(self) -> Path:
        """Return a file that leads a browser to the page, and that its owner alone can read.

        All users of a machine see the arguments of a browser, where the link would tell them its token. The file goes
        when the server is closed, or with the process. OSError where it cannot be written.
        """
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="sheetsplat-", ignore_cleanup_errors=True)
        path = Path(self._folder.name, "viewer.html")
        with open(path, "w", encoding="utf-8", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
            file.write(_REDIRECTION.format(url=self.url))
        return path

    def close(self) -> None:
        """Stop serving."""
        if self._folder is not None:
            self._folder.cleanup()
        ended = self._ended
        if ended is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(ended.set)
            self._thread.join(10.0)

    def _run(self, port: int, started: Future[int]) -> None:
        # It cancels what is still under way in the end.
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve(port, started))

    async def _serve(self, port: int, started: Future[int]) -> None:
        from aiohttp import web

        self._ended = asyncio.Event()
        application = web.Application(client_max_size=1024)
        application.router.add_route("*", "/{tail:.*}", self._answer)
        runner = web.AppRunner(
            application,
            access_log=None,
            handle_signals=False,
            shutdown_timeout=1.0,
            keepalive_timeout=self._limits.patience,
            logger=_http_log(),
        )
        await runner.setup()
        assert runner.server is not None
        try:
            with _listening(self._host, port) as listener:
                taking = asyncio.create_task(accept(listener, runner.server, self._strangers, self._limits.pause))
                started.set_result(listener.getsockname()[1])
                await self._ended.wait()
                taking.cancel()
                await asyncio.wait([taking])
        except BaseException as error:
            if started.done():
                raise
            started.set_exception(error)
        finally:
            await runner.cleanup()

    def _is_host(self, given: str) -> bool:
        """Return whether the Host that a browser names is an address of this server, not a name that leads to it."""
        name = given.rpartition(":")[0] if given.rpartition(":")[2].isdigit() else given
        name = name.strip("[]").lower()
        if name in _LOOPBACK or name == self._host.lower():
            return True
        if is_loopback(self._host):
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _may(self, request: web.Request) -> bool:
        """Return whether a request comes from somebody with the link, by a browser that was not led here."""
        if not self._is_host(request.headers.get("Host", "")):
            return False
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.headers['Host']}":
            return False
        given = request.path.split("/")[1]
        return hmac.compare_digest(given.encode(errors="surrogateescape"), self._token.encode())

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        from aiohttp import web

        nothing = web.Response(status=404, headers=_HEADERS)
        nothing.force_close()
        if request.method != "GET" or not self._may(request):
            return nothing
        self._strangers.know(request.transport)
        name = request.path.split("/", 2)[2] if request.path.count("/") > 1 else None
        if name == "socket":
            # Browsers name the origin of every websocket.
            if "Origin" not in request.headers or self._pages >= _MOST_PAGES:
                return nothing
            # Counted before anything is waited for: many may come at once.
            self._pages += 1
            try:
                return await self._talk(request)
            finally:
                self._pages -= 1
        found = files.served(name or "") if name is not None else None
        if found is None:
            return nothing
        kind, content = found
        return web.Response(body=content, headers={**_HEADERS, "Content-Type": kind})

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        """Carry messages between a page and the session until the page is gone."""
        from aiohttp import WSMsgType, web

        line = web.WebSocketResponse(max_msg_size=LONGEST, heartbeat=self._limits.heartbeat, compress=False)
        if not line.can_prepare(request):
            return web.Response(status=404, headers=_HEADERS)
        try:
            await line.prepare(request)
        except ConnectionError:
            # Gone before it was there.
            return web.Response(status=404, headers=_HEADERS)
        transport = request.transport
        assert transport is not None
        outbox = _Outbox(transport.abort)

        def deliver(message: dict[str, Any], payload: bytes) -> None:
            data = packed(message, payload) if payload else json.dumps(message, allow_nan=False)
            is_frame = message["type"] == "frame"
            self._loop.call_soon_threadsafe(lambda: outbox.put(data, is_frame=is_frame))

        client: Client = self._session.connect(deliver)
        sender = asyncio.create_task(_send(line, outbox))
        try:
            async for message in line:
                if message.type is WSMsgType.TEXT:
                    await self._loop.run_in_executor(None, self._session.receive_text, client, message.data)
        finally:
            self._session.disconnect(client)
            sender.cancel()
        return line


async def _send(line: web.WebSocketResponse, outbox: _Outbox) -> None:
    """Send what waits, in its order."""
    try:
        while True:
            data = await outbox.next()
            if isinstance(data, bytes):
                await line.send_bytes(data)
            else:
                await line.send_str(data)
    except (ConnectionError, RuntimeError):
        # The page is gone; the reader of the same socket ends, too.
        return
