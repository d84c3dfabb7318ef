"""The report page in a real browser.

Usage: COLMAP=PATH report_page_test.py

Exit code 77 without a Chromium (DGSFM_CHROMIUM names one that is not on the
path).
"""

import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import chromium  # noqa: E402

IS_READY = "document.documentElement?.dataset.ready === 'true'"
HOSTILE = "</script><img src=x onerror=window.hacked=1>.ppm"
NUM_POINTS = 25
WIDTH, HEIGHT = 64, 48


def write_images(folder, names):
    for i, name in enumerate(names):
        pixels = bytes([40 * i, 200, 100]) * (WIDTH * HEIGHT)
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"P6 %d %d 255\n" % (WIDTH, HEIGHT) + pixels)


def write_model(folder, names):
    """Images side by side that look at a red grid of points, 5 units away."""
    points = [(x - 2, y - 2, 5) for y in range(5) for x in range(5)]
    assert len(points) == NUM_POINTS
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE {WIDTH} {HEIGHT} 50 32 24\n")
    images, tracks = [], [""] * len(points)
    for image, name in enumerate(names):
        offset = image - 1
        images.append(f"{image + 1} 1 0 0 0 {-offset} 0 0 1 {name}")
        images.append(" ".join(
            f"{50 * (x - offset) / z + 32} {50 * y / z + 24} {i + 1}"
            for i, (x, y, z) in enumerate(points)
        ))  # fmt: skip
        tracks = [track + f" {image + 1} {i}" for i, track in enumerate(tracks)]
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    (folder / "points3D.txt").write_text("".join(
        f"{i + 1} {x} {y} {z} 255 0 0 0{track}\n"
        for i, ((x, y, z), track) in enumerate(zip(points, tracks))
    ))  # fmt: skip


def write_run(folder):
    """A run with three images and one that is missing."""
    names = ["a/left.ppm", "middle.ppm", HOSTILE]
    write_model(folder / "0", names)
    # A name that is a path with an unreadable image beside it: no thumbnail.
    write_images(folder / "images", names[:2] + ["lost.ppm"])
    pairs = [
        (names[0], names[1], "valid", 40),
        (names[1], names[2], "valid", 30),
        (names[0], names[2], "rotation_outlier", 12),
        (names[0], "lost.ppm", "too_few_inliers", 3),
    ]
    camera = {
        "camera_id": 1, "model": "SIMPLE_PINHOLE", "intrinsics_prior": "none",
        "prior": [60, 32, 24], "prior_stddevs": [None, 0, 0],
        "posterior": [50, 32, 24], "posterior_stddevs": [0.5, 0, 0], "group": 1,
    }  # fmt: skip
    report = {
        "stages": [{"stage": "bundle_adjustment", "images": 3, "seconds": 2.5,
                    "cpu_seconds": 4.0, "peak_memory_mb": 123.0}],
        "models": [{"images": 3, "points": NUM_POINTS, "unit": "metres",
                    "images_with_depth_scale": 3, "depth_scale_log_spread": 0.02}],
        "warnings": ["The lens <b>bends</b> lines."],
        "cameras": [camera],
        "images": [{"name": name, "registered": True, "depth_scale": 1.25 + 0.1 * i}
                   for i, name in enumerate(names)]
        + [{"name": "lost.ppm", "registered": False,
            "reason": "no valid pair: 1 too_few_inliers"}],
        "view_graph": [{"image1": a, "image2": b, "status": status,
                        "num_matches": 50, "num_inliers": inliers}
                       for a, b, status, inliers in pairs],
    }  # fmt: skip
    (folder / "report.json").write_text(json.dumps(report))
    (folder / "project.ini").write_text("num_threads=4\nimage_path=\n")


def luminance(color):
    """Of "rgb(r, g, b)", as WCAG defines it."""
    channels = [int(c) / 255 for c in color[color.index("(") + 1 : -1].split(",")[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


class ReportPage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        folder = pathlib.Path(cls.folder.name)
        write_run(folder)
        cls.page = str(folder / "report.html")
        cls.report(folder, cls.page, "--image_path", folder / "images")
        cls.bare_page = str(folder / "bare.html")
        cls.report(folder / "0", cls.bare_page)
        for name in folder.glob("0/*"):
            name.unlink()
        (folder / "0").rmdir()
        cls.failed_page = str(folder / "failed.html")
        cls.report(folder, cls.failed_page)
        cls.browser = chromium.Chromium()

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()
        cls.folder.cleanup()

    @staticmethod
    def report(input_path, output_path, *options):
        subprocess.run(
            [os.environ["COLMAP"], "model_reporter", "--input_path", input_path,
             "--output_path", output_path, *options],
            check=True, capture_output=True,
        )  # fmt: skip

    def setUp(self):
        self.browser.messages.clear()
        self.browser.requests.clear()
        self.browser.set_color_scheme("light")
        self.browser.open(self.page, IS_READY)

    def tearDown(self):
        self.assertEqual(self.browser.messages, [])

    def value(self, expression):
        return self.browser.evaluate(expression)

    def text(self, selector):
        return self.value(f"document.querySelector({json.dumps(selector)}).innerText")

    def test_asks_for_nothing_but_itself(self):
        elsewhere = [r for r in self.browser.requests if not r.startswith("data:")]
        self.assertEqual(elsewhere, ["file://" + self.page])

    def test_shows_what_the_data_say(self):
        count = "page.sceneCard.view.points.geometry.attributes.position.count"
        self.assertEqual(self.value(count), NUM_POINTS)
        # Eight edges with two ends each.
        frusta = "page.sceneCard.view.frusta.geometry.attributes.position.count"
        self.assertEqual(self.value(frusta), 3 * 16)
        summary = self.text("#summary")
        for part in ("3 of 4", "25", "metres", "2.50 s", "123 MB"):
            self.assertIn(part, summary)
        self.assertIn("The lens <b>bends</b> lines.", self.text("#look"))
        self.assertIn("1 image of 4 is missing", self.text("#look"))
        missing = self.text("#missing")
        self.assertIn("lost.ppm", missing)
        self.assertIn("no valid pair: 1 too few inliers", missing)
        self.assertIn("What to do:", missing)
        self.assertIn("rotation outlier", self.text("#pairs"))
        self.assertIn("num_threads", self.text("#options"))
        self.assertNotIn("image_path", self.text("#options table"))
        cameras = self.value("document.querySelector('#cameras table').textContent")
        self.assertIn("50 ± 0.500", cameras)
        self.assertEqual(self.value("document.querySelectorAll('#depth .dot').length"), 3)

    def test_names_are_no_markup(self):
        self.assertIsNone(self.value("window.hacked"))
        self.assertIn(HOSTILE, self.text("#images"))
        self.assertEqual(self.value("document.querySelectorAll('img[src=x]').length"), 0)

    def pixels(self, condition):
        """Pixels of the 3D view whose r, g and b satisfy a condition."""
        return self.value(
            """(() => {
              const {renderer, scene, camera} = page.sceneCard.view;
              renderer.render(scene, camera);
              const gl = renderer.getContext();
              const {drawingBufferWidth: w, drawingBufferHeight: h} = gl;
              const bytes = new Uint8Array(4 * w * h);
              gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
              let count = 0;
              for (let i = 0; i < bytes.length; i += 4) {
                const [r, g, b] = bytes.slice(i, i + 3);
                if (%s) ++count;
              }
              return count;
            })()"""
            % condition
        )

    def test_draws_points_in_their_colour(self):
        red = self.pixels("r > 200 && g < 60 && b < 60")
        # A point is a square of 3 px; some are behind lines.
        self.assertGreater(red, 3 * NUM_POINTS)
        self.assertLess(red, 12 * NUM_POINTS)
        blue = "b > r + 60"
        self.assertEqual(self.pixels(blue), 0)
        # The first choice are the valid pairs.
        self.value("document.querySelector('.pair-choice input').click()")
        self.assertGreater(self.pixels(blue), 20)

    def place_of(self, xyz):
        """Where the 3D view has a position: [x, y] of the window."""
        return self.value(
            f"""(() => {{
              const {{camera, canvas}} = page.sceneCard.view;
              canvas.scrollIntoView({{block: 'center', behavior: 'instant'}});
              camera.updateMatrixWorld();
              const at = new THREE.Vector3(...{xyz}).project(camera);
              const box = canvas.getBoundingClientRect();
              return [box.left + (at.x + 1) / 2 * box.width,
                      box.top + (1 - at.y) / 2 * box.height];
            }})()"""
        )

    def test_picks_cameras_and_points(self):
        self.browser.click(*self.place_of("page.data.images[1].center"))
        details = self.text(".details")
        name = self.value("page.data.images[1].name")
        for part in (name, "registered", "Coverage", "1.25"):
            self.assertIn(part, details)
        self.assertTrue(self.value("document.querySelector('.details img') !== null"))
        point = "page.data.models[0].points.positions.slice(0, 3)"
        self.browser.click(*self.place_of(point))
        details = self.text(".details")
        self.assertIn("Point", details)
        self.assertIn("3 images", details)
        self.assertEqual(self.value("document.querySelectorAll('.views li').length"), 3)

    def test_works_by_keyboard(self):
        self.value("document.getElementById('scene').focus()")
        position = "page.sceneCard.view.camera.position.toArray()"
        before = self.value(position)
        self.browser.press("ArrowLeft")
        turned = self.value(position)
        self.assertGreater(math.dist(before, turned), 1e-3)
        self.browser.press("+")
        self.assertGreater(math.dist(turned, self.value(position)), 1e-3)
        self.browser.press("0")
        self.assertLess(math.dist(before, self.value(position)), 1e-6)
        self.browser.press("n")
        self.assertIn("Median error", self.text(".details"))
        self.browser.press("Escape")
        self.assertIn("Images per point", self.text(".details"))
        self.value("document.getElementById('matrix').focus()")
        self.browser.press("ArrowRight")
        self.assertIn(" and ", self.text("#pairs .readout"))

    def test_focus_follows_the_page(self):
        seen = []
        self.value("document.body.focus()")
        for _ in range(60):
            self.browser.press("Tab")
            seen.append(self.value(
                "document.activeElement.id || document.activeElement.className"
                " || document.activeElement.textContent"))  # fmt: skip
        self.assertEqual(seen[0], "skip")
        order = ["scene", "image-choice", "matrix"]
        places = [seen.index(name) for name in order]
        self.assertEqual(places, sorted(places))

    def test_screen_readers_get_names(self):
        nodes = self.browser.accessible_nodes()
        self.assertIn(("application", "3D view of points and cameras"), nodes)
        roles = {role for role, _ in nodes}
        for role in ("banner", "navigation", "main", "contentinfo", "table"):
            self.assertIn(role, roles)
        headings = [name for role, name in nodes if role == "heading"]
        self.assertIn("Missing images", headings)
        controls = ("button", "link", "combobox", "checkbox", "searchbox",
                    "img", "image", "application", "table", "region")  # fmt: skip
        nameless = [node for node in nodes if node[0] in controls and not node[1]]
        self.assertEqual(nameless, [])

    def test_light_and_dark_are_legible(self):
        surfaces = []
        for scheme in ("light", "dark"):
            self.browser.set_color_scheme(scheme)
            card = self.value("getComputedStyle(document.querySelector('.card')).backgroundColor")
            surfaces.append(luminance(card))
            for selector in ("body", ".help", "a", ".tile dt", ".notes li"):
                color = self.value(f"getComputedStyle(document.querySelector('{selector}')).color")
                light, dark = sorted([luminance(color), luminance(card)], reverse=True)
                # WCAG AA for text.
                self.assertGreater((light + 0.05) / (dark + 0.05), 4.5, (scheme, selector))
            # The 3D view follows, once the browser has reported the change.
            for _ in range(100):
                background = self.value("page.sceneCard.view.scene.background.r")
                if (background > 0.5) == (scheme == "light"):
                    break
                time.sleep(0.1)
            self.assertEqual(background > 0.5, scheme == "light")
        self.assertGreater(surfaces[0], 0.9)
        self.assertLess(surfaces[1], 0.05)

    def test_narrow_windows_need_no_sideways_scrolling(self):
        self.browser.resize(420, 800)
        self.browser.paint()
        self.assertLessEqual(self.value("document.documentElement.scrollWidth"), 420)
        self.browser.resize(1280, 900)

    def test_other_models_and_failed_runs_have_pages(self):
        self.browser.open(self.bare_page, IS_READY)
        self.assertIn("25", self.text("#summary"))
        self.assertIn("no report.json", self.text("#footer-note"))
        self.browser.open(self.failed_page, IS_READY)
        self.assertIn("0 of 4", self.text("#summary"))
        self.assertIn("No model could be reconstructed", self.text("#look"))

    def test_works_without_webgl(self):
        with chromium.Chromium(webgl=False) as browser:
            browser.open(self.page, IS_READY)
            text = browser.evaluate("document.body.innerText")
            self.assertIn("This browser has no WebGL", text)
            self.assertIn("lost.ppm", text)
            self.assertEqual(browser.messages, [])


if __name__ == "__main__":
    if chromium.find_chromium() is None:
        print("skipped: no Chromium (apt-get install chromium)")
        sys.exit(77)
    unittest.main()
