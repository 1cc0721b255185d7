"""A headless Chromium, driven over two pipes by its DevTools protocol.

The program is `chromium` of Debian, or the one that the variable CHROMIUM names.
"""

from __future__ import annotations

import base64
import io
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_SWITCHES = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-sync",
    "--hide-scrollbars",
    "--metrics-recording-only",
    "--no-first-run",
    "--no-default-browser-check",
)
_SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_PATIENCE_S = 120.0


def program() -> str:
    """The browser's program; the test fails with what to do where there is none."""
    expected = os.environ.get("CHROMIUM")
    result = [path for name in ([expected] if expected else NAMES) if (path := shutil.which(name))]
    if not result:
        raise AssertionError(
            "this test opens the report in Chromium: apt-get install --yes chromium, "
            "or name a Chromium or Chrome with the variable CHROMIUM"
        )
    return result[0]


class Page:
    """A page in the browser, with what it fetched and what went wrong in it."""

    def __init__(self, send: Callable[..., Any]) -> None:
        self._send = send
        self.requests: list[str] = []
        self.faults: list[str] = []

    def heard(self, method: str, values: dict[str, Any]) -> None:
        """Take down a request, an exception or an error in the console."""
        if method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.faults.append(str(values["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and values["type"] in ("error", "warning"):
            self.faults.append(str(values["args"]))
        elif method == "Log.entryAdded" and values["entry"]["level"] in ("error", "warning"):
            self.faults.append(str(values["entry"]))

    def open(self, path: Path, fragment: str = "") -> None:
        """Open a file and wait until its scripts are done."""
        self._send("Page.navigate", url=path.resolve().as_uri() + fragment)
        self.wait("document.documentElement?.dataset.ready === 'yes'")

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page."""
        answer = self._send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until a JavaScript expression is true."""
        end = time.monotonic() + _PATIENCE_S
        while not self.run(expression):
            assert time.monotonic() < end, f"never true: {expression}; {self.faults}"
            time.sleep(0.05)

    def settle(self) -> None:
        """Wait until what was asked to be drawn is drawn."""
        self.run("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element in the window, scrolled to."""
        result = self.run(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            "e.scrollIntoView({block: 'center', behavior: 'instant'});"
            "const b = e.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()"
        )
        left, top, width, height = map(float, result)
        return left, top, width, height

    def click(self, selector: str) -> None:
        """Press and release the mouse's left button in the middle of an element."""
        left, top, width, height = self.place(selector)
        at = {"x": left + width / 2, "y": top + height / 2, "button": "left", "clickCount": 1}
        self._send("Input.dispatchMouseEvent", type="mousePressed", **at)
        self._send("Input.dispatchMouseEvent", type="mouseReleased", **at)

    def choose(self, label: str, value: str) -> None:
        """Choose a value of the list that is labelled so."""
        self.run(
            "(() => { const named = [...document.querySelectorAll('label')]"
            f".find((l) => l.firstChild.textContent === {json.dumps(label)});"
            "const select = named.querySelector('select');"
            f"select.value = {json.dumps(value)}; select.dispatchEvent(new Event('change')); }})()"
        )

    def drag(self, selector: str, across: float, down: float) -> None:
        """Drag from the middle of an element."""
        left, top, width, height = self.place(selector)
        x, y = left + width / 2, top + height / 2
        held = {"button": "left", "buttons": 1}
        self._send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, clickCount=1, **held)
        x, y = x + across, y + down
        self._send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **held)
        self._send("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **held)

    def point_at(self, x: float, y: float) -> None:
        """Move the mouse there."""
        self._send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def press(self, key: str) -> None:
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self._send("Input.dispatchKeyEvent", type=kind, key=key, code=key)

    def show(self, width: int, height: int, *, dark: bool = False, media: str = "") -> None:
        """Set the window's size, a dark scheme, and what it is shown on ("print" for paper)."""
        self._send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._send("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def picture(self, selector: str | None = None) -> NDArray[np.uint8]:
        """Pixels (height, width, 3) of the window, or of an element in it."""
        self.settle()
        options: dict[str, Any] = {}
        if selector is not None:
            left, top, width, height = self.place(selector)
            self.settle()
            scrolled = self.run("[scrollX, scrollY]")
            options["clip"] = {
                "x": left + scrolled[0],
                "y": top + scrolled[1],
                "width": width,
                "height": height,
                "scale": 1,
            }
        answer = self._send("Page.captureScreenshot", format="png", **options)
        image = Image.open(io.BytesIO(base64.b64decode(answer["data"])))
        return np.asarray(image.convert("RGB"))


class _Connection:
    """Messages to and from the browser: JSON objects that end in a zero byte."""

    def __init__(self, read: int, write: int) -> None:
        self._read, self._write = read, write
        self._rest, self._number = b"", 0
        self.session: str | None = None
        self.page = Page(self.send)

    def send(self, method: str, **parameters: Any) -> Any:
        """Ask for something and return the answer."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        number = self._number
        while True:
            answer = self._next(method)
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self.page.heard(answer.get("method", ""), answer.get("params", {}))

    def _next(self, method: str) -> dict[str, Any]:
        end = time.monotonic() + _PATIENCE_S
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser does not answer {method}"
            part = os.read(self._read, 1 << 20)
            assert part, f"the browser ended before it answered {method}"
            self._rest += part
        text, _, self._rest = self._rest.partition(b"\0")
        answer: dict[str, Any] = json.loads(text)
        return answer


@contextmanager
def browser(folder: Path, *, webgl: bool = True) -> Iterator[Page]:
    """A page in a browser of its own, which keeps its profile in `folder`."""
    to_browser, from_browser = os.pipe(), os.pipe()
    switches = [*_SWITCHES, *(_SOFTWARE_GL if webgl else ["--disable-3d-apis"])]
    if os.geteuid() == 0:
        switches.append("--no-sandbox")  # which root cannot have
    pipes = f"3<&{to_browser[0]} 4>&{from_browser[1]}"
    words = [program(), *switches, f"--user-data-dir={folder}", "about:blank"]
    process = subprocess.Popen(
        ["bash", "-c", f'exec "$@" {pipes}', "bash", *words],
        pass_fds=(to_browser[0], from_browser[1]),
        env={**os.environ, "HOME": str(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for end in (to_browser[0], from_browser[1]):
        os.close(end)
    try:
        yield _first_page(_Connection(from_browser[0], to_browser[1]))
    finally:
        process.terminate()
        process.wait(30)
        for end in (from_browser[0], to_browser[1]):
            os.close(end)


def _first_page(connection: _Connection) -> Page:
    targets = connection.send("Target.getTargets")["targetInfos"]
    target = next(item["targetId"] for item in targets if item["type"] == "page")
    attached = connection.send("Target.attachToTarget", targetId=target, flatten=True)
    connection.session = attached["sessionId"]
    for domain in ("Page", "Runtime", "Network", "Log"):
        connection.send(f"{domain}.enable")
    connection.page.show(1280, 900)
    return connection.page
