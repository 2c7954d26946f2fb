"""A headless Chromium for the tests of the page, driven through its DevTools pipe: no port, no
driver, no dependency."""

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-quic"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--force-color-profile=srgb", "--remote-debugging-pipe"),
)
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WAIT_S = 60.0
FIRST_FREE = 10
"""Descriptors from here on cannot be the two that Chromium listens on."""


def program() -> str:
    """Where the browser is. Fails without one: skipped, nobody would have looked at the page."""
    for name in PROGRAMS:
        if path := shutil.which(name):
            return path
    raise AssertionError(
        f"none of {', '.join(PROGRAMS)} is on this machine; install it (apt-get install chromium) "
        "to test the report's page"
    )


class Page:
    """One tab. ``errors`` holds what the open page's scripts threw or logged as an error, and
    ``requests`` the addresses that it asked for."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from, self._buffer = to_browser, from_browser, b""
        self._last, self._session = 0, None
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: object) -> dict:
        """What a DevTools command answers."""
        self._last += 1
        message = {"id": self._last, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._last:
            self._notice(answer)
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    def _receive(self) -> dict:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], WAIT_S)
            assert ready, f"the browser has said nothing for {WAIT_S:g} s"
            received = os.read(self._from, 1 << 20)
            assert received, "the browser has ended"
            self._buffer += received
        message, self._buffer = self._buffer.split(b"\0", 1)
        return json.loads(message)

    def _notice(self, event: dict) -> None:
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(parameters["exceptionDetails"]))
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(json.dumps(parameters["entry"]))
        elif method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])

    def show(self, width: int, height: int, dark: bool = False, phone: bool = False) -> None:
        """The size of the window, and which colours the reader prefers."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", media="", features=[scheme])

    def open(self, path: Path) -> None:
        """Load a file; what went wrong and was asked for before is forgotten."""
        self.errors.clear()
        self.requests.clear()
        self.send("Page.navigate", url=path.resolve().as_uri())
        self.wait("document.readyState === 'complete'")

    def wait(self, condition: str) -> None:
        """Until an expression is true."""
        until_s = time.monotonic() + WAIT_S
        while not self.evaluate(condition):
            assert time.monotonic() < until_s, f"not within {WAIT_S:g} s: {condition}"
            time.sleep(0.05)

    def evaluate(self, expression: str) -> object:
        """The value of a JavaScript expression; of a promise, what it resolves to."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def screenshot(self, path: Path, whole: bool = False) -> None:
        """A PNG of the window, or of the whole page."""
        encoded = self.send("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        path.write_bytes(base64.b64decode(encoded))

    def press(self, key: str, shift: bool = False) -> None:
        """A key, by its DOM name."""
        text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, modifiers=8 * shift, **text
            )
            text = {}

    def drag(self, start: tuple[float, float], end: tuple[float, float], **options) -> None:
        """The mouse, pressed at one place of the window and released at another."""
        for kind, (x, y), buttons in (
            ("mousePressed", start, 1),
            ("mouseMoved", end, 1),
            ("mouseReleased", end, 0),
        ):
            mouse = {"x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1}
            self.send("Input.dispatchMouseEvent", type=kind, **{**mouse, **options})


@contextmanager
def opened(webgl: bool = True) -> Iterator[Page]:
    """A page of a browser that starts with nothing and leaves nothing."""
    options = [*OPTIONS, *(SOFTWARE_WEBGL if webgl else ("--disable-3d-apis",))]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program(), *options, f"--user-data-dir={profile}", "about:blank"]
        to_browser, from_browser, process = _start(command, profile)
        try:
            yield Page(to_browser, from_browser)
        finally:
            os.close(to_browser)
            os.close(from_browser)
            _end(process)


def _start(command: list[str], home: str) -> tuple[int, int, int]:
    """Start the browser: it reads commands from descriptor 3 and writes answers to 4."""
    ends = [_moved_up(end) for pipe in (os.pipe(), os.pipe()) for end in pipe]
    its_input, to_browser, from_browser, its_output = ends
    quiet = os.open(os.devnull, os.O_RDWR)
    process = os.posix_spawn(
        command[0],
        command,
        {**os.environ, "HOME": home},
        file_actions=[
            (os.POSIX_SPAWN_DUP2, quiet, 1),
            (os.POSIX_SPAWN_DUP2, quiet, 2),
            (os.POSIX_SPAWN_DUP2, its_input, 3),
            (os.POSIX_SPAWN_DUP2, its_output, 4),
        ],
    )
    for end in (its_input, its_output, quiet):
        os.close(end)
    return to_browser, from_browser, process


def _end(process: int) -> None:
    """Ask the browser to end, and end it where a script keeps it busy."""
    os.kill(process, signal.SIGTERM)
    until_s = time.monotonic() + 10
    while os.waitpid(process, os.WNOHANG) == (0, 0):
        if time.monotonic() > until_s:
            os.kill(process, signal.SIGKILL)
        time.sleep(0.05)


def _moved_up(descriptor: int) -> int:
    """The same file under a higher number, which no child inherits by itself."""
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, FIRST_FREE)
    os.close(descriptor)
    return moved
