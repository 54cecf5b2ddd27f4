"""A headless Chromium, driven over its own pipe: a few dozen lines instead of a dependency."""

import base64
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

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_FLAGS = (
    "--headless=new", "--no-sandbox", "--hide-scrollbars", "--disable-background-networking", "--no-first-run",
    "--disable-component-update", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
_FROM_US, _TO_US = 3, 4  # the file numbers on which Chromium reads and writes


def find_chromium() -> str | None:
    """The path of a Chromium, from the environment's CHROMIUM or the usual names."""
    named = os.environ.get("CHROMIUM")
    return named or next((path for path in map(shutil.which, _NAMES) if path), None)


class Browser:
    """One tab, with all that it said and asked the network for."""

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        self._buffer, self._count, self._session = b"", 0, None
        self.complaints: list[str] = []
        self.requests: list[str] = []

    def start(self) -> None:
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and wait for its answer."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session and not method.startswith("Target."):
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._writer, data) :]
        while True:
            answer = self._next(30)
            if answer.get("id") == self._count:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def open(self, page: Path, width: int = 1366, height: int = 768, *, touch: bool = False) -> None:
        """Show a file and wait until its script has run."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch)
        self.send("Emulation.setTouchEmulationEnabled", enabled=touch)
        self.send("Page.navigate", url=page.resolve().as_uri())
        self.wait_for("document.readyState === 'complete' && Boolean(window.report)")

    def value(self, expression: str) -> Any:
        """What a JavaScript expression gives, as JSON values."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression: str, seconds: float = 20) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + seconds
        while not self.value(expression):
            assert time.monotonic() < end, f"never true: {expression}; the page said {self.complaints}"
            time.sleep(0.02)

    def press(self, key: str, *, shift: bool = False) -> None:
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 * shift, **text)

    def centre(self, selector: str) -> tuple[float, float]:
        """Where an element's middle is on the screen, scrolled into view."""
        x, y = self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            "e.scrollIntoView({block: 'center'});"
            "const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        return x, y

    def click(self, place: tuple[float, float]) -> None:
        self.drag(place, place)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse at one place, move, and let go at another."""
        self._mouse("mousePressed", start)
        if end != start:
            for share in (0.25, 0.5, 0.75, 1.0):
                self._mouse("mouseMoved", tuple(a + share * (b - a) for a, b in zip(start, end, strict=True)))
        self._mouse("mouseReleased", end)

    def wheel(self, place: tuple[float, float], down: float) -> None:
        self.send("Input.dispatchMouseEvent", type="mouseWheel", x=place[0], y=place[1], deltaX=0, deltaY=down)

    def touch(self, *steps: list[tuple[float, float]]) -> None:
        """Fingers at these places, step by step, then lifted."""
        for number, places in enumerate(steps):
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            self.send("Input.dispatchTouchEvent", type="touchMove" if number else "touchStart", touchPoints=points)
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def screenshot(self) -> bytes:
        """The page as PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])

    def _mouse(self, kind: str, place: tuple[float, ...]) -> None:
        held = 0 if kind == "mouseReleased" else 1
        self.send(
            "Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", buttons=held, clickCount=1
        )

    def _next(self, seconds: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            assert select.select([self._reader], [], [], seconds)[0], "Chromium does not answer"
            data = os.read(self._reader, 1 << 20)
            assert data, "Chromium has ended"
            self._buffer += data
        message, _, self._buffer = self._buffer.partition(b"\0")
        document = json.loads(message)
        self._note(document.get("method", ""), document.get("params", {}))
        return document

    def _note(self, method: str, what: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(what["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and what["type"] in {"error", "warning", "assert"}:
            self.complaints.append(json.dumps(what["args"]))
        elif method == "Log.entryAdded" and what["entry"]["level"] in {"error", "warning"}:
            self.complaints.append(json.dumps(what["entry"]))


@contextmanager
def chromium(program: str, profile: Path, *flags: str) -> Iterator[Browser]:
    """A running Chromium, ended afterwards."""
    (their_in, our_out), (our_in, their_out) = os.pipe(), os.pipe()
    process = subprocess.Popen(
        [program, *_FLAGS, *flags, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        preexec_fn=_place(their_in, their_out), pass_fds=(_FROM_US, _TO_US),  # noqa: PLW1509 - only file numbers move
    )  # fmt: skip
    os.close(their_in)
    os.close(their_out)
    try:
        browser = Browser(our_in, our_out)
        browser.start()
        yield browser
    finally:
        process.kill()
        process.wait()
        os.close(our_in)
        os.close(our_out)


def _place(their_in: int, their_out: int) -> Callable[[], None]:
    def place() -> None:
        # Out of the way first: either may already have the number the other is to get.
        high_in, high_out = os.dup(their_in), os.dup(their_out)
        while min(high_in, high_out) <= _TO_US:
            high_in, high_out = os.dup(high_in), os.dup(high_out)
        os.dup2(high_in, _FROM_US)
        os.dup2(high_out, _TO_US)

    return place
