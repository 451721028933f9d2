"""Pages looked at in Chromium without a window: what they draw and what they complain of."""

import base64
import json
import os
import re
import shutil
import subprocess
import tempfile
import time

import matplotlib.image
import numpy as np
import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")


def browser():
    """Path of Chromium; the test is skipped where there is none."""
    for name in _NAMES:
        path = shutil.which(name)
        if path is not None:
            return path
    return pytest.skip("no Chromium here to look at the page with")


def opened(page, *words):
    """Open a page in Chromium without a window; what it wrote. It hangs once in a while: then it is begun anew."""
    left = 3
    while True:
        # A profile that another process has not let go of yet would be waited for.
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            command = [browser(), "--headless=new", "--no-sandbox", f"--user-data-dir={profile}", *words, page.as_uri()]
            try:
                return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
            except subprocess.TimeoutExpired:
                left -= 1
                if not left:
                    raise


def look(page, picture, width, height=800):
    """Draw a page to a picture; its pixels (height, width, 3) in 0 … 1, and what the console said."""
    done = opened(
        page,
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--hide-scrollbars",
        "--enable-logging=stderr",
        f"--window-size={width},{height}",
        "--virtual-time-budget=2000",
        f"--screenshot={picture}",
    )
    said = re.findall(r"CONSOLE[^\]]*\] (.*)", done.stderr)
    return np.asarray(matplotlib.image.imread(picture))[:, :, :3], said


class Tab:
    """A page at work in Chromium without a window, in real time: pointer, values of its script, what the console says.

    Chromium is asked through pipes (its DevTools protocol).
    """

    def __init__(self, page, width=1000, height=800, dark=False):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, from_browser = os.pipe(), os.pipe()
        # The browser reads 3 and writes 4.
        shell = f'exec 3<&{to_browser[0]} 4>&{from_browser[1]}; exec "$@"'
        words = ["--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--hide-scrollbars"]
        words += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", f"--user-data-dir={self.profile.name}"]
        self.process = subprocess.Popen(
            ["bash", "-c", shell, "bash", browser(), *words, "about:blank"],
            pass_fds=(to_browser[0], from_browser[1]),
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser[0])
        os.close(from_browser[1])
        self.out, self.into = os.fdopen(to_browser[1], "wb"), os.fdopen(from_browser[0], "rb")
        self.number, self.session, self.said, self.left = 0, None, [], b""
        target = next(t for t in self.ask("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page", "Network"):
            self.ask(f"{domain}.enable")
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.ask("Emulation.setEmulatedMedia", features=scheme)
        self.ask("Page.navigate", url=page.as_uri())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.out.close()
        self.process.kill()
        self.process.wait()
        self.into.close()
        self.profile.cleanup()

    def ask(self, method, **parameters):
        """The browser's answer; what it says in between goes to `said`."""
        self.number += 1
        text = {"id": self.number, "method": method, "params": parameters}
        self.out.write(json.dumps(text | ({"sessionId": self.session} if self.session else {})).encode() + b"\0")
        self.out.flush()
        while True:
            while b"\0" not in self.left:
                part = os.read(self.into.fileno(), 1 << 16)
                assert part, "Chromium has ended"
                self.left += part
            line, self.left = self.left.split(b"\0", 1)
            told = json.loads(line)
            if told.get("method") in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"):
                self.said.append(told["params"])
            if told.get("method") == "Network.requestWillBeSent":
                self.said += [
                    url for url in [told["params"]["request"]["url"]] if not url.startswith(("file:", "blob:"))
                ]
            if told.get("id") == self.number:
                assert "error" not in told, told
                return told["result"]

    def value(self, expression):
        """Value of an expression of the page's script, awaited."""
        found = self.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, expression, seconds=60):
        """Wait until an expression holds; how long it took, s."""
        begin = time.monotonic()
        while not self.value(f"document.body ? {expression} : false"):
            assert time.monotonic() - begin < seconds, expression
            time.sleep(0.02)
        return time.monotonic() - begin

    def pointer(self, kind, x, y):
        """Move, press or release the mouse."""
        button = {"button": "left", "buttons": 1, "clickCount": 1} if kind != "mouseMoved" or self.held else {}
        self.held = kind == "mousePressed" or (self.held and kind != "mouseReleased")
        self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    held = False

    def place(self):
        """Where the last interface of a live body is on the screen, px."""
        # Drawn anew first: the tools above may just have changed the picture's size.
        return self.value(
            "new Promise(then => requestAnimationFrame(() => requestAnimationFrame(then))).then(() => {"
            " const r = area.getBoundingClientRect(), s = screen(live.ends.at(-1), r.width, r.height);"
            " return [r.left + s[0], r.top + s[1]]; })"
        )

    def pull(self, right, up, moves=1):
        """Take the last interface of a live body with the pointer and pull it, px; where the pointer is then."""
        x, y = self.place()
        self.pointer("mousePressed", x, y)
        assert self.value("live.pull !== null || live.refused !== ''"), "the pointer missed the interface"
        for k in range(1, moves + 1):
            self.pointer("mouseMoved", x + right * k / moves, y - up * k / moves)
        return x + right, y - up

    def picture(self, path):
        """Draw the page to a file."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot")["data"]))
