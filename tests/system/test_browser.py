"""The report in a real browser: its slider moves the blocks. Skipped where there is no browser."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.system.program import run_here, write_scene

webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium: make browser")
BROWSER, DRIVER = (shutil.which(name) for name in ("chromium", "chromedriver"))
pytestmark = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="no chromium with its driver: make browser"
)
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-sync"
    " --disable-background-networking --disable-component-update --disable-dev-shm-usage"
)


@pytest.fixture
def page(folder, tmp_path_factory, capsys):
    """The report of a tower that tips, in a browser."""
    from selenium.webdriver.chrome.service import Service

    rough = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
    write_scene(folder, rough | {"output.paraview": False, "output.report": True}, "tower")
    assert run_here(["solve", "scene.toml"], capsys).code == 0
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(service=Service(DRIVER), options=options)
    driver.get((Path("scene") / "report.html").absolute().as_uri())
    yield driver
    driver.quit()


def block(page, number: int):
    """Where a block is on the screen, and its motion as the page has it."""
    place = page.find_elements("css selector", "figure.moving [data-motion]")[number]
    return place.rect, place.get_attribute("transform")


def test_the_slider_moves_the_blocks_and_is_not_in_print(page):
    from selenium.webdriver.common.keys import Keys

    slider = page.find_element("css selector", "figure.moving input")
    assert slider.is_displayed()
    _, shown = block(page, 1)
    slider.send_keys(Keys.HOME)
    rest, unmoved = block(page, 1)
    assert unmoved == "matrix(1 0 0 1 0 0)" != shown
    slider.send_keys(Keys.END)
    far, _ = block(page, 1)
    slider.send_keys(Keys.ARROW_LEFT)
    near, _ = block(page, 1)
    # The tower tips to the right about its toe: the upper block moves right and down its corner.
    assert far["x"] + far["width"] > near["x"] + near["width"] > rest["x"] + rest["width"]
    assert [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"] == []
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert not page.find_element("css selector", "figure.moving input").is_displayed()
    # Print has one picture of the collapse, that of page 1.
    assert not page.find_element("css selector", "figure.moving svg").is_displayed()
    assert page.find_element("css selector", ".first img").is_displayed()
