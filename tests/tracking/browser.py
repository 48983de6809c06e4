"""The dashboard in a real browser: an MLflow server over a store, and the system's chromium, driven."""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

PATIENCE_S = 120
SIZE = (1280, 860)
CLOSE_ASSISTANT = (
    "document.querySelectorAll('button[aria-label=Close], button[aria-label=close]').forEach(b => b.click())"
)


def missing() -> str:
    """Why no browser can be driven here; empty where one can."""
    for name in ("chromium", "chromedriver"):
        if shutil.which(name) is None:
            return f"no {name}: apt-get install chromium chromium-driver"
    return "" if find_spec("selenium") else "no selenium: pip install -c constraints.txt -e '.[browser]'"


@contextmanager
def served(command: str) -> Iterator[str]:
    """Run the command that opens the dashboard, at a port of its own; gives its address."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    words = [*shlex.split(command), "--port", str(port), "--workers", "1"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(words, start_new_session=True, **quiet)
    try:
        until = time.monotonic() + PATIENCE_S
        while not _answers(f"http://127.0.0.1:{port}/health"):
            assert server.poll() is None and time.monotonic() < until, "the server did not start"
            time.sleep(0.2)
        yield f"http://127.0.0.1:{port}"
    finally:
        os.killpg(server.pid, 15)
        server.wait(PATIENCE_S)


def _answers(address: str) -> bool:
    try:
        with urllib.request.urlopen(address, timeout=2) as answer:
            return answer.status == 200
    except OSError:
        return False


class Page:
    """What the browser shows."""

    def __init__(self, profile: Path) -> None:
        from selenium import webdriver

        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium")
        for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
            options.add_argument(word)
        options.add_argument(f"--window-size={SIZE[0]},{SIZE[1]}")
        options.add_argument(f"--user-data-dir={profile}")
        self.driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))

    def open(self, address: str, *texts: str) -> None:
        """Open an address, and wait until all the texts are to be seen."""
        self.driver.get("about:blank")  # another fragment alone would load nothing
        self.driver.get(address)
        self.wait(*texts)

    def wait(self, *texts: str) -> None:
        until = time.monotonic() + PATIENCE_S
        while lacking := [text for text in texts if text not in self.text()]:
            assert time.monotonic() < until, f"not to be seen: {lacking}, but {self.text()[:2000]}"
            time.sleep(0.2)

    def text(self) -> str:
        return self.driver.execute_script("return document.body.innerText")

    def points(self) -> list[int]:
        """How many points each curve of the page's charts has."""
        script = """
            return [...document.querySelectorAll('.js-plotly-plot')].flatMap(
                plot => plot.data.filter(trace => trace.x && trace.type != 'bar').map(trace => trace.x.length))"""
        return self.driver.execute_script(script)

    def steps(self) -> list[list[float]]:
        """Where the points of each curve lie."""
        script = """
            return [...document.querySelectorAll('.js-plotly-plot')].flatMap(
                plot => plot.data.filter(trace => trace.x && trace.type != 'bar').map(trace => [...trace.x]))"""
        return self.driver.execute_script(script)

    def charts(self) -> int:
        return self.driver.execute_script("return document.querySelectorAll('.js-plotly-plot').length")

    def images(self) -> list[str]:
        """Addresses of the pictures that are loaded."""
        script = "return [...document.images].filter(i => i.complete && i.naturalWidth > 100).map(i => i.src)"
        return self.driver.execute_script(script)

    def wait_for(self, true) -> None:
        until = time.monotonic() + PATIENCE_S
        while not true():
            assert time.monotonic() < until, self.text()[:2000]
            time.sleep(0.2)

    def keep(self, name: str) -> None:
        """A screenshot for the documentation, where the folder DASHBOARD_SHOTS is named."""
        if folder := os.environ.get("DASHBOARD_SHOTS"):
            self.driver.execute_script(CLOSE_ASSISTANT)
            time.sleep(1.5)  # charts fade in
            self.driver.save_screenshot(str(Path(folder) / f"dashboard_{name}.png"))

    def close(self) -> None:
        self.driver.quit()
