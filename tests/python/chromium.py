"""A headless Chromium, driven by the DevTools protocol: what the tests of the viewer's page need of one."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
_PATIENCE = 60.0


def missing() -> str:
    """Return why no browser can be driven here, or an empty text."""
    if not any(map(shutil.which, NAMES)):
        return "no Chromium (one of: " + ", ".join(NAMES) + ")"
    try:
        import aiohttp  # noqa: F401
    except ImportError:
        return "no package aiohttp"
    return ""


class Chromium:
    """A browser without a window; `page` opens pages in it."""

    def __init__(self, *flags: str) -> None:
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._loop = asyncio.new_event_loop()
        program = next(found for found in map(shutil.which, NAMES) if found)
        command = [program, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        command += ["--remote-debugging-port=0", f"--user-data-dir={self._folder.name}", "--no-first-run", *flags]
        self._process = subprocess.Popen(
            [*command, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        port_file = Path(self._folder.name) / "DevToolsActivePort"
        end = time.monotonic() + _PATIENCE
        while not (port_file.exists() and port_file.read_text().count("\n")):
            if time.monotonic() > end or self._process.poll() is not None:
                self.close()
                raise RuntimeError("Chromium did not start")
            time.sleep(0.05)
        port, path = port_file.read_text().split("\n")[:2]
        self._number = 0
        self.events: list[dict[str, Any]] = []
        self._session, self._line = self._loop.run_until_complete(self._dial(f"http://127.0.0.1:{port}{path}"))

    async def _dial(self, address: str) -> tuple[Any, Any]:
        import aiohttp

        session = aiohttp.ClientSession()
        return session, await session.ws_connect(address, max_msg_size=0)

    def command(self, method: str, session: str | None = None, **parts: Any) -> dict[str, Any]:
        """Return the answer to a command of the protocol; events that come meanwhile go to `events`."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parts}
        if session is not None:
            message["sessionId"] = session
        return self._loop.run_until_complete(asyncio.wait_for(self._answer(message), _PATIENCE))

    async def _answer(self, message: dict[str, Any]) -> dict[str, Any]:
        await self._line.send_str(json.dumps(message))
        while True:
            answer = json.loads((await self._line.receive()).data)
            if answer.get("id") == message["id"]:
                if "error" in answer:
                    raise RuntimeError(f"{message['method']}: {answer['error']}")
                found: dict[str, Any] = answer["result"]
                return found
            self.events.append(answer)

    def page(self, address: str, size: tuple[int, int] = (1200, 760)) -> Page:
        """Open a page in a tab of its own."""
        target = self.command("Target.createTarget", url="about:blank")["targetId"]
        session = self.command("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return Page(self, session, target, address, size)

    def close(self) -> None:
        """End the browser."""
        if hasattr(self, "_session"):
            self._loop.run_until_complete(self._session.close())
        self._process.terminate()
        self._process.wait(20.0)
        self._loop.close()
        self._folder.cleanup()


class Page:
    """One tab."""

    def __init__(self, browser: Chromium, session: str, target: str, address: str, size: tuple[int, int]) -> None:
        self._browser, self._session, self._target = browser, session, target
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(f"{domain}.enable")
        self.resize(size)
        self.go(address)

    def command(self, method: str, **parts: Any) -> dict[str, Any]:
        return self._browser.command(method, self._session, **parts)

    def resize(self, size: tuple[int, int], ratio: float = 1.0) -> None:
        width, height = size
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=False
        )

    def go(self, address: str) -> None:
        self.command("Page.navigate", url=address)

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression of JavaScript, awaited where it is a promise."""
        found = self.command("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            details = found["exceptionDetails"]
            raise AssertionError(details.get("exception", {}).get("description") or details["text"])
        return found["result"].get("value")

    def wait(self, expression: str, seconds: float = 30.0) -> Any:
        """Wait until an expression is true, and return its value."""
        end = time.monotonic() + seconds
        while True:
            found = self.evaluate(f"(() => {{ try {{ return {expression} }} catch {{ return null }} }})()")
            if found:
                return found
            if time.monotonic() > end:
                raise AssertionError(f"still false: {expression}")
            time.sleep(0.03)

    def mouse(self, kind: str, at: tuple[float, float], **parts: Any) -> None:
        self.command("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **parts)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 8, modifiers: int = 0) -> None:
        held = {"button": "left", "modifiers": modifiers}
        self.mouse("mouseMoved", start)
        self.mouse("mousePressed", start, clickCount=1, **held)
        for n in range(1, steps + 1):
            at = tuple(a + (b - a) * n / steps for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", at, buttons=1, **held)  # type: ignore[arg-type]
        self.mouse("mouseReleased", end, clickCount=1, **held)

    def click(self, at: tuple[float, float], count: int = 1, button: str = "left") -> None:
        for n in range(1, count + 1):
            self.mouse("mousePressed", at, button=button, clickCount=n)
            self.mouse("mouseReleased", at, button=button, clickCount=n)

    def key(self, key: str, modifiers: int = 0) -> None:
        text = {"text": key} if len(key) == 1 else {}
        self.command("Input.dispatchKeyEvent", type="keyDown", key=key, modifiers=modifiers, **text)
        self.command("Input.dispatchKeyEvent", type="keyUp", key=key, modifiers=modifiers)

    def faults(self) -> list[str]:
        """Return what the page complained about: exceptions, and errors in the log."""
        self.evaluate("0")
        found = []
        for event in self._browser.events:
            if event.get("sessionId") != self._session:
                continue
            if event["method"] == "Runtime.exceptionThrown":
                details = event["params"]["exceptionDetails"]
                found.append(details.get("exception", {}).get("description") or details["text"])
            elif event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] == "error":
                found.append(event["params"]["entry"]["text"])
        return found

    def screenshot(self, path: str | Path) -> None:
        data = self.command("Page.captureScreenshot", format="png")["data"]
        Path(path).write_bytes(base64.b64decode(data))

    def close(self) -> None:
        self._browser.command("Target.closeTarget", targetId=self._target)
