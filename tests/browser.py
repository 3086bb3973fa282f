"""A real browser without a window, driven over WebDriver with nothing but the standard library.

`python tests/browser.py REPORT.html docs/report.png` takes the picture of the docs: a report on a screen and a phone.
"""

import base64
import contextlib
import io
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DRIVER = "chromedriver"
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage")

OVERFLOWING = """
const wide = document.documentElement.clientWidth + 1;
const boxed = (e) => e.closest('.scroll, pre') && !e.matches('.scroll, pre');
return [...document.querySelectorAll('body *')]
  .filter((e) => e.getBoundingClientRect().right > wide && !boxed(e))
  .map((e) => e.tagName + ' ' + e.className + ' ' + e.textContent.slice(0, 40));
"""
"""Elements that go beyond the right edge, but for those in a box that scrolls by itself."""


def missing() -> str | None:
    """What keeps these tests from running here; None where nothing does."""
    if browser_path() is None:
        return f"no browser: none of {', '.join(BROWSERS)} (Debian: apt install chromium)"
    if shutil.which(DRIVER) is None:
        return f"no {DRIVER} (Debian: apt install chromium-driver)"
    return None


def browser_path() -> str | None:
    return next((found for found in map(shutil.which, BROWSERS) if found), None)


class Browser:
    """A window of a browser."""

    def __init__(self, address: str, session: str) -> None:
        self._address, self._session = address, session

    def open(self, page: Path | str, width: int, height: int = 800) -> None:
        """Show a page in a window of so many pixels."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.command("Emulation.setDeviceMetricsOverride", **size)
        self._ask("url", {"url": page.as_uri() if isinstance(page, Path) else page})

    def run(self, script: str) -> Any:
        """What a script returns."""
        return self._ask("execute/sync", {"script": script, "args": []})

    def overflowing(self) -> list[str]:
        """What makes the page wider than the window."""
        found: list[str] = self.run(OVERFLOWING)
        wider = self.run("return document.documentElement.scrollWidth - document.documentElement.clientWidth")
        return [*found, *([f"the page by {wider} pixels"] if wider > 0 else [])]

    def complaints(self) -> list[str]:
        """Lines of the console, warnings and worse, since the last time."""
        return [line["message"] for line in self._log("browser") if line["level"] in ("WARNING", "SEVERE")]

    def requests(self) -> list[str]:
        """Addresses on a network that were asked for since the last time."""
        events = [json.loads(line["message"])["message"] for line in self._log("performance")]
        sent = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
        return [url for url in sent if url.startswith(("http:", "https:", "ws:", "wss:"))]

    def pdf(self) -> bytes:
        """The page as it prints."""
        printed = self.command("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        return base64.b64decode(printed["data"])

    def screenshot(self) -> bytes:
        """The whole page as PNG."""
        rows, columns = self.run("const root = document.documentElement; return [root.scrollHeight, root.clientWidth]")
        clip = {"x": 0, "y": 0, "width": columns, "height": rows, "scale": 1}
        return base64.b64decode(
            self.command("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)["data"]
        )

    def command(self, name: str, **parameters: object) -> Any:
        """A command of the DevTools protocol."""
        return self._ask("goog/cdp/execute", {"cmd": name, "params": parameters})

    def _log(self, kind: str) -> list[dict[str, Any]]:
        lines: list[dict[str, Any]] = self._ask("se/log", {"type": kind})
        return lines

    def _ask(self, path: str, body: dict[str, object]) -> Any:
        return ask(f"{self._address}/session/{self._session}/{path}", body)


def ask(url: str, body: dict[str, object] | None = None, method: str | None = None) -> Any:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=60.0) as answer:
        return json.load(answer)["value"]


def pdf_pages(pdf: bytes) -> int:
    """How many pages a PDF of the browser has."""
    return len(re.findall(rb"/Type\s*/Page\b(?!s)", pdf))


@contextlib.contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser with an empty profile, closed in the end."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    home = {**os.environ, "HOME": str(profile)}
    driver = subprocess.Popen([DRIVER, f"--port={port}"], stdout=subprocess.DEVNULL, env=home)
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(600):
            with contextlib.suppress(urllib.error.URLError, ConnectionError):
                ask(f"{address}/status")
                break
            time.sleep(0.05)
        options = {"args": [*FLAGS, f"--user-data-dir={profile / 'data'}"], "binary": browser_path()}
        wanted = {
            "browserName": "chrome",
            "goog:chromeOptions": options,
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }
        session = ask(f"{address}/session", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]
        try:
            yield Browser(address, session)
        finally:
            ask(f"{address}/session/{session}", method="DELETE")
    finally:
        driver.terminate()
        driver.wait(30)


SHOWN = ((1100, 0), (360, 0), (360, 1))
"""Widths of the windows in the picture of the docs, and which stretch of the page each shows."""
ROWS, GAP = 1560, 24


def take_picture(page: Path, picture: Path) -> None:
    """Set a page on a screen and two stretches of it on a phone side by side."""
    from PIL import Image

    whole = Image.new("RGB", (sum(width for width, _ in SHOWN) + GAP * (len(SHOWN) + 1), ROWS + 2 * GAP), "#8c959f")
    left = GAP
    with tempfile.TemporaryDirectory() as profile, browser(Path(profile)) as window:
        for width, stretch in SHOWN:
            window.open(page, width)
            shot = Image.open(io.BytesIO(window.screenshot()))
            top = stretch and int(window.run("return document.querySelector('#time').getBoundingClientRect().top"))
            whole.paste(shot.crop((0, top, width, top + ROWS)), (left, GAP))
            left += width + GAP
    whole.quantize(256).save(picture, optimize=True)


if __name__ == "__main__":
    take_picture(Path(sys.argv[1]).resolve(), Path(sys.argv[2]))
