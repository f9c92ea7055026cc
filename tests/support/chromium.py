"""Headless Chromium, driven through its own protocol: what a page draws, says and asks for."""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Self

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 90  # [s] until a page that never draws is given up


def find() -> str | None:
    """Return the program, None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Chromium:
    """One browser with one tab.

    Attributes:
        requests: Addresses that pages asked for, data addresses left out.
        complaints: Errors and warnings of their consoles, and exceptions.
    """

    def __init__(self, folder: Path) -> None:
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self._sent, self._session = 0, None
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        # the protocol is spoken through file descriptors 3 and 4
        words = [find(), "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe"]
        words += ["--no-first-run", "--disable-background-networking", f"--user-data-dir={folder / 'profile'}"]
        script = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", *words], pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        self._stream = os.fdopen(self._read, "rb", buffering=0)
        self._rest = b""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setScrollbarsHidden", hidden=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        self._stream.close()
        os.close(self._write)

    def call(self, method: str, **parameters: object) -> dict:
        """Call a method of the protocol and return its result."""
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._sent:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def open(self, page: Path, width: int, dark: bool = False) -> None:
        """Open a page in a window of a width [px] and wait until its charts are drawn."""
        self.look(width, dark)
        self.call("Page.navigate", url=page.resolve().as_uri())
        assert self.wait("document.body && document.body.dataset.drawn"), self.complaints

    def look(self, width: int, dark: bool) -> None:
        """Change the window's width [px], and whether the reader prefers dark pages."""
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)

    def wait(self, condition: str) -> bool:
        """Wait until a JavaScript expression holds in the page; return whether it ever did."""
        return bool(
            self.value(
                f"""new Promise((done) => {{
                    const end = Date.now() + {1000 * PATIENCE};
                    const look = () =>
                        ({condition}) ? done(true) : Date.now() > end ? done(false) : setTimeout(look, 50);
                    look();
                }})"""
            )
        )

    def value(self, expression: str) -> object:
        """Return the value of a JavaScript expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def screenshot(self, path: Path, height: int | None = None) -> None:
        """Write a picture of the page, its whole length where no height [px] is given."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": height or size["height"], "scale": 1}
        shot = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def _next(self) -> dict:
        while b"\0" not in self._rest:
            part = self._stream.read(1 << 20)
            assert part, "the browser ended"
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict) -> None:
        about = event.get("params", {})
        if event.get("method") == "Network.requestWillBeSent":
            url = about["request"]["url"]
            self.requests += [] if url.startswith(("data:", "blob:")) else [url]
        elif event.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(about["exceptionDetails"]))
        elif event.get("method") == "Runtime.consoleAPICalled" and about["type"] in ("error", "warning", "assert"):
            self.complaints.append(json.dumps(about["args"]))
        elif event.get("method") == "Log.entryAdded" and about["entry"]["level"] in ("error", "warning"):
            self.complaints.append(about["entry"]["text"])
