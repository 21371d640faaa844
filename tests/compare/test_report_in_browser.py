"""The report in a real browser without a window: Chromium through Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes

from o3d_sofnn.cli import main

o3d = pytest.importorskip("open3d")
playwright = pytest.importorskip("playwright.sync_api")

NAMES = ("chromium", "chromium-browser", "google-chrome")
METHODS = ("ours", "open3d_alpha_shape")
# WebGL by the processor: a test machine has no graphics card.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
LAPTOP = {"viewport": {"width": 1366, "height": 900}, "color_scheme": "light"}
PHONE = {
    "viewport": {"width": 390, "height": 844},
    "color_scheme": "dark",
    "device_scale_factor": 2,
    "has_touch": True,
    "is_mobile": True,
}
READ_BACK = """
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return plain.call(this, kind, kind === "2d" ? { willReadFrequently: true } : options);
};"""
PIXELS = """panes => panes.map(canvas => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let seen = 0, sum = 0;
  for (let k = 0; k < data.length; k += 4) {
    if (data[k + 3]) { seen++; sum = (sum * 31 + k + data[k]) % 1e9; }
  }
  return [canvas.dataset.drawn, seen / (data.length / 4), sum];
})"""


# Names of files that would run script if they were taken for markup.
SCAN = '{{scenes}}" autofocus onfocus="window.hurt = 1" x="<img src=x onerror=window.hurt=2>'
MISSING = "<img src=x onerror=window.hurt=3> {{scenes}}"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    o3d.io.write_triangle_mesh(str(folder / "ball.ply"), ball)
    np.savetxt(folder / f"{SCAN}.xyz", shapes.torus(600).points)
    files = [str(folder / name) for name in ("ball.ply", f"{SCAN}.xyz", f"{MISSING}.ply")]
    small = ["--quick", "--points", "600", "--sizes", "--noise", "0", "1", "--out", str(folder)]
    main.main(["compare", *files, *small, "--methods", *METHODS])
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser here: none of {', '.join(NAMES)}")
    with playwright.sync_playwright() as tools:
        running = tools.chromium.launch(executable_path=program, args=FLAGS)
        yield running
        running.close()


def open_page(browser: Any, report: Path, options: dict[str, Any]) -> tuple[Any, list[str]]:
    """Return the page, and a list that grows with everything that goes wrong on it."""
    page = browser.new_context(**options, offline=True).new_page()
    trouble: list[str] = []
    page.on("console", lambda message: trouble.append(message.text))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("requestfailed", lambda request: trouble.append(f"wanted {request.url[:100]}"))
    # This test reads many pixels back; the page itself never does.
    page.add_init_script(READ_BACK)
    page.goto(report.as_uri())
    page.wait_for_function(
        "() => [...document.querySelectorAll('.view canvas')].some(pane => pane.dataset.drawn)"
    )
    return page, trouble


def panes(page: Any, mode: str) -> list[list[Any]]:
    """Return what is drawn, the share of pixels, and a number for the picture, of each pane."""
    page.wait_for_timeout(300)
    found = page.locator(".view canvas").evaluate_all(PIXELS)
    assert all(drawn in (mode, "") for drawn, _, _ in found)
    return found


def test_panes_are_drawn_and_turn_together(browser: Any, report: Path) -> None:
    page, trouble = open_page(browser, report, LAPTOP)
    before = panes(page, "surface")
    assert len(before) == 1 + len(METHODS)
    assert all(0.02 < share < 0.9 for _, share, _ in before)
    box = page.locator(".view").nth(1).bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 140, steps=3)
    page.mouse.up()
    turned = panes(page, "surface")
    assert all(a[2] != b[2] for a, b in zip(before, turned, strict=True))
    page.locator(".view").nth(0).focus()
    page.keyboard.press("+")
    larger = panes(page, "surface")
    assert all(b[1] > a[1] for a, b in zip(turned, larger, strict=True))
    page.click("#reset")
    assert panes(page, "surface") == before
    assert trouble == []


def test_normals_and_flipped_normals_are_shown(browser: Any, report: Path) -> None:
    page, trouble = open_page(browser, report, LAPTOP)
    for mode in ("normals", "flipped"):
        page.check(f"input[value={mode}]")
        page.wait_for_function(
            "mode => document.querySelector('.view canvas').dataset.drawn === mode", arg=mode
        )
        shares = [share for _, share, _ in panes(page, mode)]
        assert shares[0] > 0.02
        assert shares[1] > 0.02
        assert shares[2] == 0.0  # alpha shapes have no normals
        assert page.locator(".open3d_alpha_shape .view p").inner_text() != ""
    # The scan is the last choice; its truth is not known, so nothing can be called flipped.
    page.select_option("#scene", index=2)
    assert all(share == 0.0 for _, share, _ in panes(page, "flipped"))
    page.check("input[value=surface]")
    assert all(share > 0.02 for _, share, _ in panes(page, "surface"))
    assert trouble == []


def test_tables_sort_both_ways(browser: Any, report: Path) -> None:
    page, trouble = open_page(browser, report, LAPTOP)
    values = """key => {
      const table = document.getElementById("results");
      const column = [...table.tHead.rows[0].cells].findIndex(cell => cell.dataset.key === key);
      return [...table.tBodies[0].rows].map(row => row.cells[column]?.dataset.value ?? "");
    }"""
    for key, kind in (("seconds", float), ("method", str), ("chamfer", float)):
        button = page.locator(f"#results th[data-key={key}] button")
        for reverse in (False, True):
            button.click()
            shown = page.evaluate(values, key)
            known = [kind(value) for value in shown if value != ""]
            assert known == sorted(known, reverse=reverse)
            assert shown[len(known) :] == [""] * (len(shown) - len(known))  # the rest is below
    assert trouble == []


def test_names_of_files_run_no_script(browser: Any, report: Path) -> None:
    page, trouble = open_page(browser, report, LAPTOP)
    page.select_option("#scene", index=2)
    page.wait_for_timeout(300)
    inputs = page.locator("#results td:nth-child(2)").all_inner_texts()
    assert {"ball", SCAN, MISSING} == set(inputs)
    assert page.locator("#scene option").nth(2).inner_text().startswith(SCAN)
    assert trouble == []
    # Even markup that got into the page would run nothing, and load nothing.
    page.evaluate("""() => {
      document.body.insertAdjacentHTML("beforeend", "<img src=x onerror='window.hurt = 4'>");
      const script = document.createElement("script");
      script.textContent = "window.hurt = 5";
      document.body.append(script);
    }""")
    page.wait_for_timeout(300)
    assert page.evaluate("window.hurt === undefined")
    assert trouble
    assert all("Content Security Policy" in text or "wanted" in text for text in trouble)


@pytest.mark.parametrize(("options", "dark"), [(LAPTOP, False), (PHONE, True)])
def test_laptop_and_phone_light_and_dark(
    browser: Any, report: Path, options: dict[str, Any], dark: bool
) -> None:
    page, trouble = open_page(browser, report, options)
    width = options["viewport"]["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    color = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, color.strip("rgb()").split(","))) < 200) is dark
    for element in page.locator("h1, .pane, .chart, .scroll").all():
        box = element.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width + 1
    if options is PHONE:
        assert page.locator(".chart text").first.bounding_box()["height"] >= 8
    assert trouble == []


def test_without_webgl_there_are_pictures(browser: Any, report: Path) -> None:
    page = browser.new_context(**LAPTOP).new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(report.as_uri())
    assert page.locator("#no-webgl").is_visible()
    assert page.locator(".view canvas").count() == 0
    loaded = "images => images.map(image => image.complete && image.naturalWidth > 0)"
    page.wait_for_timeout(300)
    assert all(page.locator(".view img").evaluate_all(loaded))
