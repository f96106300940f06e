"""The viewer in a real browser: it turns, and moves the blocks. Skipped where there is none."""

from __future__ import annotations

import io
import json
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.image import imread

from fenics_contact.output.report.viewer import write_viewer
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.view import views_of
from tests.spatial.test_output import TOWER, structure_of
from tests.system.test_browser import BROWSER, DRIVER, FLAGS, webdriver

pytestmark = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="no chromium with its driver: make browser"
)


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    profile = tmp_path_factory.mktemp("profile")
    for flag in (*FLAGS.split(), "--enable-unsafe-swiftshader", f"--user-data-dir={profile}"):
        options.add_argument(flag)
    made = webdriver.Chrome(service=Service(DRIVER), options=options)
    yield made
    made.quit()


@pytest.fixture(scope="module", params=["", "#plain"], ids=["WebGL", "canvas"])
def page(driver, request, tmp_path_factory):
    """A tower that tips; drawn by WebGL, and without. Nothing goes wrong, or out."""
    structure = structure_of(TOWER, 0.8, [1.0, 0.0, 0.0])
    collapse = collapse_of(structure)
    result = SpatialLimit(None, structure, {"positive": collapse, "negative": collapse})
    folder = tmp_path_factory.mktemp("viewer")
    write_viewer(views_of(result), folder)
    driver.get((folder / "viewer.html").as_uri() + request.param)
    yield driver
    assert [one for one in driver.get_log("browser") if one["level"] == "SEVERE"] == []
    sent = [json.loads(one["message"])["message"] for one in driver.get_log("performance")]
    addresses = [
        one["params"]["request"]["url"]
        for one in sent
        if one["method"] == "Network.requestWillBeSent"
    ]
    assert [address for address in addresses if address.startswith(("http", "ws"))] == []


def picture(page):
    """What the canvas shows."""
    image = page.find_element("id", "canvas").screenshot_as_png
    return imread(io.BytesIO(image))[5:-5, 5:-5, :3]  # without the ring of what has the focus


def blue(page):
    """Columns and rows of pixels as blue as what moves most."""
    image = picture(page)
    rows, columns = np.nonzero(image[..., 2] - image[..., 0] > 0.3)
    return columns, rows


def click(page, selector):
    page.find_element("css selector", selector).click()


def test_slider_moves_the_blocks(page):
    from selenium.webdriver.common.keys import Keys

    click(page, "#colour option[value='share']")
    click(page, "[data-turn='-90 0']")  # from the front
    click(page, "#marks")
    slider = page.find_element("id", "motion")
    places = []
    for key in (Keys.HOME, Keys.END):
        slider.send_keys(key)
        places.append(blue(page)[0].max())
    assert places[1] > places[0] + 5  # it tips to the right


def test_keys_and_mouse_turn_the_blocks(page):
    from selenium.webdriver.common.action_chains import ActionChains

    canvas = page.find_element("id", "canvas")
    canvas.send_keys("\ue011")  # home
    seen = [picture(page)]
    canvas.send_keys("\ue014")  # an arrow
    seen.append(picture(page))
    ActionChains(page).drag_and_drop_by_offset(canvas, 80, 30).perform()
    seen.append(picture(page))
    canvas.send_keys("+")
    seen.append(picture(page))
    for before, after in pairwise(seen):
        assert np.abs(before - after).max() > 0.2
    canvas.send_keys("\ue011")  # home
    assert np.abs(picture(page) - seen[0]).max() < 0.1


def test_colours_and_names(page):
    click(page, "#colour option[value='share']")
    assert len(blue(page)[0])
    click(page, "#marks")
    click(page, "#colour option[value='group']")
    assert not len(blue(page)[0])
    click(page, "[data-turn='-90 0']")
    canvas = page.find_element("id", "canvas")
    canvas.click()
    told = page.find_element("id", "told").text
    assert "group tower" in told and "moves" in told
    assert page.find_element("id", "direction").is_displayed()
