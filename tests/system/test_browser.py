"""The report in a real browser: its slider moves the blocks. Skipped where there is no browser."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

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


def rightmost(page) -> int:
    """The last column of the picture with a block that moves: blue."""
    image = imread(io.BytesIO(page.find_element("id", "canvas").screenshot_as_png))
    return int(np.nonzero(image[..., 2] - image[..., 0] > 0.2)[1].max(initial=0))


def test_the_slider_moves_the_blocks(page):
    from selenium.webdriver.common.keys import Keys

    page.switch_to.frame(page.find_element("css selector", "iframe"))
    slider = page.find_element("id", "motion")
    assert slider.is_displayed()
    assert not page.find_element("id", "eyes").is_displayed()  # nothing to turn in the plane
    places = []
    for key in (Keys.HOME, Keys.ARROW_RIGHT, Keys.END):
        slider.send_keys(key)
        places.append(rightmost(page))
    # The tower tips to the right about its toe.
    assert places[0] <= places[1] < places[2]
    page.find_element("id", "canvas").click()
    assert "moves" in page.find_element("id", "told").text
    assert [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_print_has_no_slider(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    # Print has one picture of the collapse, that of page 1.
    assert not page.find_element("css selector", "iframe").is_displayed()
    assert page.find_element("css selector", ".first img").is_displayed()
