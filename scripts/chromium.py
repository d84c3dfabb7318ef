"""Drives a headless Chromium through its debugging pipe, for pages on disk.

Needs a Chromium and no Python package. The 3D view is drawn in software, so
that it works on machines without a graphics card too.
"""

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time

NAMES = ["chromium", "chromium-browser", "google-chrome", "chrome"]


def find_chromium():
    """The program, or None: DGSFM_CHROMIUM, or what is on the path."""
    named = os.environ.get("DGSFM_CHROMIUM")
    if named:
        return named
    return next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with one page; a context manager.

    `messages` are errors and warnings of the page's console, and `requests` the
    addresses that it asked for.
    """

    def __init__(self, width=1280, height=900, webgl=True):
        self.messages = []
        self.requests = []
        self._next_id = 0
        self._pending = b""
        self._profile = tempfile.TemporaryDirectory(prefix="chromium-")
        to_browser, self._write_end = os.pipe()
        self._read_end, from_browser = os.pipe()
        graphics = ["--enable-unsafe-swiftshader", "--use-angle=swiftshader"]
        if not webgl:
            graphics = ["--disable-gpu", "--disable-3d-apis"]
        command = [
            find_chromium(), "--headless=new", "--no-sandbox", "--no-first-run",
            "--disable-dev-shm-usage", "--hide-scrollbars",
            "--disable-background-networking", "--disable-component-update",
            f"--user-data-dir={self._profile.name}",
            f"--window-size={width},{height}",
            "--remote-debugging-pipe", *graphics, "about:blank",
        ]  # fmt: skip

        # The browser reads from descriptor 3 and writes to 4.
        read_end, write_end = os.dup(to_browser), os.dup(from_browser)
        script = f'exec 3<&{read_end} 4>&{write_end}; exec "$@"'
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", *command],
            pass_fds=[read_end, write_end],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (to_browser, from_browser, read_end, write_end):
            os.close(end)
        targets = self.send("Target.getTargets", session=None)["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = None
        self._session = self.send(
            "Target.attachToTarget", targetId=page, flatten=True, session=None
        )["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network", "Accessibility"):
            self.send(domain + ".enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self.send("Browser.close", session=None)
            self._process.wait(timeout=20)
        except (OSError, EOFError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._write_end)
        os.close(self._read_end)
        # Helper processes of the browser may still write a moment.
        for _ in range(20):
            try:
                self._profile.cleanup()
                break
            except OSError:
                time.sleep(0.1)

    def _receive(self):
        while b"\0" not in self._pending:
            block = os.read(self._read_end, 1 << 20)
            if not block:
                raise EOFError("the browser has ended")
            self._pending += block
        message, self._pending = self._pending.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event):
        params = event.get("params", {})
        if event["method"] == "Runtime.consoleAPICalled":
            if params["type"] in ("error", "warning", "assert"):
                texts = [str(a.get("value", a.get("description"))) for a in params["args"]]
                self.messages.append(" ".join(texts))
        elif event["method"] == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            error = details.get("exception", {}).get("description")
            self.messages.append(error or details["text"])
        elif event["method"] == "Log.entryAdded":
            if params["entry"]["level"] in ("error", "warning"):
                self.messages.append(params["entry"]["text"])
        elif event["method"] == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])

    def send(self, method, session="page", **params):
        """The result of a command of the DevTools protocol."""
        self._next_id += 1
        command = {"id": self._next_id, "method": method, "params": params}
        if session:
            command["sessionId"] = self._session
        os.write(self._write_end, json.dumps(command).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._next_id:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            if "method" in answer:
                self._note(answer)

    def evaluate(self, expression):
        """The value of a JavaScript expression in the page, promises awaited."""
        result = self.send(
            "Runtime.evaluate",
            expression=expression,
            returnByValue=True,
            awaitPromise=True,
        )
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"]["exception"]["description"])
        return result["result"].get("value")

    def open(self, path, is_ready="document.readyState === 'complete'", timeout=60):
        """Opens a file and returns the seconds until the condition holds and the
        page has been painted."""
        start = time.monotonic()
        self.send("Page.navigate", url="file://" + os.path.abspath(path))
        while not self.evaluate(is_ready):
            if time.monotonic() - start > timeout:
                raise TimeoutError(f"{path} is not ready after {timeout} s")
            time.sleep(0.02)
        self.paint()
        return time.monotonic() - start

    def paint(self):
        """Waits until two frames have been drawn."""
        self.evaluate(
            "new Promise((done) => requestAnimationFrame("
            "() => requestAnimationFrame(() => done(0))))"
        )

    def resize(self, width, height, scale=1):
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=scale, mobile=False,
        )  # fmt: skip

    def set_color_scheme(self, scheme):
        self.send(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )

    def press(self, key, modifiers=0, text=None):
        """Presses a key as named by JavaScript; modifiers 8 is Shift."""
        codes = {"Tab": 9, "Enter": 13, "Escape": 27, "ArrowLeft": 37,
                 "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}  # fmt: skip
        text = text or ("\r" if key == "Enter" else key if len(key) == 1 else None)
        event = {"key": key, "modifiers": modifiers, "code": key,
                 "windowsVirtualKeyCode": codes.get(key, ord(key[0]))}  # fmt: skip
        down = dict(event, text=text) if text else event
        kind = "keyDown" if text else "rawKeyDown"
        self.send("Input.dispatchKeyEvent", type=kind, **down)
        self.send("Input.dispatchKeyEvent", type="keyUp", **event)

    def click(self, x, y):
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.send(
                "Input.dispatchMouseEvent",
                type=kind, x=x, y=y, clickCount=1,
                button="none" if kind == "mouseMoved" else "left",
            )  # fmt: skip

    def screenshot(self, path=None, clip=None):
        """PNG of what is in sight, or of a box (x, y, width, height) of the page."""
        options = {}
        if clip:
            names = ("x", "y", "width", "height")
            options["clip"] = dict(zip(names, clip), scale=1)
            options["captureBeyondViewport"] = True
        answer = self.send("Page.captureScreenshot", format="png", **options)
        picture = base64.b64decode(answer["data"])
        if path:
            with open(path, "wb") as file:
                file.write(picture)
        return picture

    def accessible_nodes(self):
        """(role, name) of all that a screen reader comes across."""
        nodes = self.send("Accessibility.getFullAXTree")["nodes"]
        return [
            (node["role"]["value"], node.get("name", {}).get("value", ""))
            for node in nodes
            if not node["ignored"]
        ]
