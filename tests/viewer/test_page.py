"""The page in a headless Chromium."""

import io
import socket
import threading
import time
import urllib.request

import numpy as np
import pytest
from PIL import Image

from drpbench.errors import InputError

pytestmark = pytest.mark.slow

viser = pytest.importorskip("viser", reason="viser is not installed (extra `viewer`)")
from drpbench.viewer.page import (  # noqa: E402
    NO_SOLUTION,
    Page,
)

from .conftest import FURNISHED  # noqa: E402

PATIENCE = 60.0  # [s] for software rendering on a busy machine
# What a browser without a GPU says of itself, and three.js of its own parts.
ASIDES = ("software WebGL", "GL Driver Message", "THREE.Clock")


@pytest.fixture(scope="module")
def served(compiled):
    page = Page(compiled, "straight+dcp-rmp", "127.0.0.1", 8080)
    thread = threading.Thread(target=page.run)
    thread.start()
    yield page
    page.close()
    thread.join(10)
    assert not thread.is_alive()


@pytest.fixture
def page(served, compiled):
    """One page for all tests, which begin with the start of the furnished problem, paused."""
    if served._playing:
        served._ask("play")
    served._ask("open", FURNISHED)
    served._ask("time", "Reset")
    until(lambda: served._wishes.empty(), "a page at rest")
    until(lambda: (compiled.id, compiled.clock) == (FURNISHED, 0), "the start")
    return served


def until(told, what):
    end = time.monotonic() + PATIENCE
    while not told():
        assert time.monotonic() < end, f"not seen: {what}"
        time.sleep(0.2)


def opened(browser, page):
    browser.errors.clear()
    browser.requests.clear()
    browser("Page.navigate", url=page.address)
    until(
        lambda: browser.js("(document.body?.innerText ?? '').includes('clearance')"), "the readings"
    )


def press(browser, label):
    """Clicks the button, once the page has drawn it."""
    found = f"[...document.querySelectorAll('button')].find(b => b.textContent.trim() == {label!r})"
    until(lambda: browser.js(f"(b => b ? (b.click(), true) : false)({found})"), f"button {label}")


def says(browser, text):
    until(lambda: browser.js(f"document.body.innerText.includes({text!r})"), text)


def picture(browser, path):
    browser.screenshot(path)
    return np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert("RGB"), float)


def on_screen(page, place, width, height):
    """Pixels where a point is seen by the first camera."""
    camera = page._server.initial_camera
    ahead = camera.look_at - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y, z = np.stack([right, np.cross(ahead, right), ahead]) @ (place - camera.position)
    scale = height / 2 / np.tan(camera.fov / 2)
    return width / 2 + scale * x / z, height / 2 + scale * y / z


def complaints(browser):
    return [error for error in browser.errors if not any(aside in error for aside in ASIDES)]


def test_the_page_loads_whole_from_its_own_server(browser, page, tmp_path):
    browser.screen(1280, 800)
    opened(browser, page)
    says(browser, f"FDO {FURNISHED} with straight+dcp-rmp")
    says(browser, "No contact, not at the goal")
    until(lambda: len(np.unique(picture(browser, tmp_path / "a.png"))) > 150, "a picture")
    shown = picture(browser, tmp_path / "a.png")[:, 320:900]  # beside the panel
    red, green, blue = np.moveaxis(shown, -1, 0)
    assert ((red > 1.3 * blue) & (red > 150)).mean() > 0.005  # the goal's ghost is orange
    assert ((blue > 1.5 * red) & (blue > 120)).mean() > 0.002  # boxes are blue
    foreign = [url for url in browser.requests if url.startswith(("http:", "https:", "ws"))]
    assert foreign and all(url.startswith(page.address) for url in foreign)
    assert complaints(browser) == []


def test_play_moves_the_arm_and_reset_brings_it_back(browser, page, compiled):
    opened(browser, page)
    start = compiled.look().arm[0]
    press(browser, "Play")
    until(lambda: compiled.clock > 60, "a second")
    assert np.abs(compiled.look().arm[0] - start).max() > 0.05
    press(browser, "Pause")
    says(browser, "Play")
    clock = compiled.clock
    press(browser, "10 steps")
    until(lambda: compiled.clock == clock + 10, "ten steps")
    press(browser, "Reset")
    until(lambda: compiled.clock == 0, "the start")
    assert np.array_equal(compiled.look().arm[0], start)
    says(browser, "0.00 s of 16.7 s")
    assert complaints(browser) == []


def test_another_problem_and_another_box(browser, page, compiled):
    opened(browser, page)
    press(browser, "Next")
    says(browser, f"FDO {FURNISHED + 1} with")
    press(browser, "Add a box")
    says(browser, "Changed by hand")
    assert compiled.furniture.present[compiled.furniture.added[0]]
    press(browser, "Remove")
    until(lambda: not compiled.furniture.present[compiled.furniture.added[0]], "its removal")


def test_a_box_is_dragged_with_the_mouse(browser, page, compiled):
    browser.screen(1280, 800)
    boxes = compiled.look().box_position.copy()
    opened(browser, page)
    page._ask("boxes", False)
    says(browser, "Changed by hand")
    piece = compiled.furniture.added[0]
    place = compiled.furniture.position[piece].copy()
    at = on_screen(page, place, 1280, 800)

    def mouse(kind, x, y, **more):
        browser("Input.dispatchMouseEvent", type=kind, x=float(x), y=float(y), **more)

    time.sleep(2.0)  # until the box is drawn, and can be hit
    held = {"button": "left", "buttons": 1}
    mouse("mouseMoved", *at)
    mouse("mousePressed", *at, clickCount=1, **held)
    for step in range(1, 11):
        mouse("mouseMoved", at[0] - 8 * step, at[1], **held)
        time.sleep(0.1)
    mouse("mouseReleased", at[0] - 80, at[1], button="left")
    moved = lambda: np.linalg.norm(compiled.furniture.position[piece] - place)  # noqa: E731
    until(lambda: moved() > 0.05, "the box elsewhere")
    assert np.array_equal(compiled.look().box_position, boxes)


def test_a_goal_that_cannot_be_reached_is_told_of(browser, page, compiled):
    opened(browser, page)
    moment = compiled.look()
    page._ask("goal", np.array([3.0, 0.0, 0.0]), moment.goal_quaternion, True)
    says(browser, NO_SOLUTION)
    np.testing.assert_allclose(page._drawing.handle.position, moment.goal_position)


def test_a_phone_sees_the_arm_and_the_buttons(browser, page, tmp_path):
    browser.screen(390, 844)
    opened(browser, page)
    above = lambda: picture(browser, tmp_path / "phone.png")[150:430]  # noqa: E731
    until(lambda: above().std() > 15.0, "the arm above the buttons")
    assert browser.js("document.documentElement.scrollWidth") <= 390
    assert complaints(browser) == []


def test_a_port_that_is_taken_gives_way_to_the_next(compiled):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        page = Page(compiled, "x", "127.0.0.1", port)
        try:
            assert page.port > port and str(page.port) in page.address
            with urllib.request.urlopen(page.address, timeout=10) as answer:
                assert b"<html" in answer.read(2000)
        finally:
            page.close()


def test_an_address_that_is_not_this_machines_is_refused(compiled):
    with pytest.raises(InputError, match=r"--host 192\.0\.2\.1 --port 8080"):
        Page(compiled, "x", "192.0.2.1", 8080)


def test_nothing_is_lent_to_the_world(page):
    assert page._server.request_share_url() is None
