"""A headless Chromium for the tests of the page.

It is driven through its DevTools pipe, which needs no port, no driver and no dependency.
"""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-color-profile=srgb",
    "--remote-debugging-pipe",
]
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WAIT_S = 60.0

# Descriptors from here on cannot be the two that Chromium listens on.
FIRST_FREE = 10


def program() -> str:
    """Returns the path of the browser, and fails without one: a skipped test looks at nothing."""
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
        """Returns the answer to a DevTools command."""
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
        """Sets the size of the window, and the color scheme that the reader prefers."""
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
        """Loads a file, and forgets the errors and requests of the page before."""
        self.errors.clear()
        self.requests.clear()
        self.send("Page.navigate", url=path.resolve().as_uri())
        self.wait("document.readyState === 'complete'")

    def wait(self, condition: str) -> None:
        """Waits until an expression is true."""
        until_s = time.monotonic() + WAIT_S
        while not self.evaluate(condition):
            assert time.monotonic() < until_s, f"not within {WAIT_S:g} s: {condition}"
            time.sleep(0.05)

    def evaluate(self, expression: str) -> object:
        """Returns the value of a JavaScript expression; of a promise, the value it resolves to."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def screenshot(self) -> bytes:
        """Returns a PNG of the window."""
        return base64.b64decode(self.send("Page.captureScreenshot")["data"])

    def press(self, key: str) -> None:
        """Presses a key, by its DOM name."""
        text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, **text)
            text = {}

    def mouse(self, kind: str, x: float, y: float, button: str = "none") -> None:
        """Sends one event of the mouse at a place of the window."""
        pressed = int(button == "left")
        event = {"button": button, "buttons": pressed, "clickCount": pressed}
        if kind == "mouseReleased":
            event["buttons"] = 0
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **event)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Presses the mouse at one place of the window and releases it at another."""
        self.mouse("mousePressed", *start, "left")
        for share in (0.5, 1.0):
            self.mouse("mouseMoved", *(a + share * (b - a) for a, b in zip(start, end)), "left")
        self.mouse("mouseReleased", *end, "left")


@contextmanager
def opened(webgl: bool = True) -> Iterator[Page]:
    """Yields a page of a browser that starts with nothing and leaves nothing.

    The browser reads commands from descriptor 3 and writes answers to descriptor 4.
    """
    options = [*OPTIONS, *(SOFTWARE_WEBGL if webgl else ("--disable-3d-apis",))]
    ends = [_moved_up(end) for pipe in (os.pipe(), os.pipe()) for end in pipe]
    its_input, to_browser, from_browser, its_output = ends

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program(), *options, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{its_input} 4>&{its_output}', "bash", *command],
            env={**os.environ, "HOME": profile},
            pass_fds=(its_input, its_output),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            os.close(its_input)
            os.close(its_output)
            yield Page(to_browser, from_browser)
        finally:
            os.close(to_browser)
            os.close(from_browser)
            _end(process)


def _end(process: subprocess.Popen) -> None:
    """Asks the browser to end, and ends it where a script keeps it busy."""
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _moved_up(descriptor: int) -> int:
    """Returns the same file under a higher number, which no child inherits by itself."""
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, FIRST_FREE)
    os.close(descriptor)
    return moved
