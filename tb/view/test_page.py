"""The page in a real browser: every control, live and in replay, and what the scene looks like."""

from contextlib import contextmanager
from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest

from model.optics.rigs import RIGS
from model.optics.scenes import Plane, Polyp
from scripts.host.history import History, read_history
from scripts.host.live_chip import LiveChip
from scripts.host.port import open_port
from scripts.host.reception import Reception
from scripts.measure.ruler import ruler
from scripts.measure.surface import Surface
from scripts.simulation.live_rig import calibrated, open_live
from scripts.view.session import LiveSession
from tb.benchmark.drift import move
from tb.measure.polyps import true_rim
from tb.view.bench import WALL_COLOUR, history_of, replay, serving
from tb.view.browser import canvas_pixels, open_browser, until

FLAT = Plane(60, 0, 0)
HALF_SPHERE = Polyp(Plane(60, 5, 30), (1.0, -2.0), (6.0, 6.0, 6.0), 0.0, 3.0, 0.4)
#: Screens of a laptop and of a tablet, both ways.
SIZES = ((1280, 720), (1024, 768), (768, 1024))
RIG = replace(RIGS["small"], name="small")


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def recorded():
    """The rig, and a history of a flat wall, a half sphere on a wall, and 40 planes."""
    return history_of([FLAT, HALF_SPHERE, *(Plane(50 + 0.5 * step, 10, 0) for step in range(40))])


@contextmanager
def opened(browser, server, width=1280, height=720, **choices):
    """The page with its first frame drawn; it asked nobody else and had no error."""
    page = browser.new_page(viewport={"width": width, "height": height}, **choices)
    asked, faults = [], []
    page.on("request", lambda request: asked.append(urlsplit(request.url).netloc))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text)
            if message.type == "error" and "WebSocket" not in message.text else None)
    page.goto(server.address)
    until(page, "window.page && page.rig")
    try:
        yield page
        assert faults == []
        own = urlsplit(server.address).netloc
        assert {each for each in asked if each} == {own} and len(asked) > 5
    finally:
        page.close()


def go(page, position):
    page.evaluate(f"page.freeze(); page.go({position})")
    until(page, f"page.frame && page.frame.position === {position} && !page.waiting")


def place_in_picture(page, u, v):
    box = page.locator("#picture").bounding_box()
    return (box["x"] + (u + 0.5) / 352 * box["width"],
            box["y"] + (v + 0.5) / 288 * box["height"])


def click_picture(page, u, v):
    page.mouse.click(*place_in_picture(page, u, v))


def test_a_plane_looks_flat_and_a_sphere_does_not(browser, recorded):
    with serving(replay(recorded[1])) as server, opened(browser, server) as page:
        page.keyboard.press("d")
        page.keyboard.press("p")
        spread = []
        for position in (0, 1):
            go(page, position)
            page.keyboard.press("h")
            image = canvas_pixels(page)
            height, width = image.shape[:2]
            middle = image[height // 2 - 70:height // 2 + 70, width // 2 - 70:width // 2 + 70]
            spread.append(middle.reshape(-1, 3).std(axis=0).max())
        assert spread[0] < 3 < 8 < spread[1], spread
        # The picture lies on it: lines of the texture are seen.
        page.keyboard.press("t")
        go(page, 0)
        assert canvas_pixels(page)[height // 2 - 70:height // 2 + 70].std() > 8
        # Where the picture is old it is blue.
        page.keyboard.press("f")
        go(page, 41)
        image = canvas_pixels(page)[height // 2, width // 2 - 60:width // 2 + 60].astype(int)
        assert (image[:, 0] - image[:, 2]).mean() > 5


def test_a_sensor_with_colour_filters_has_a_picture_in_colour(browser):
    history = history_of([FLAT], bayer="GRBG")[1]
    with serving(replay(history)) as server, opened(browser, server) as page:
        page.keyboard.press("p")
        go(page, 0)
        image = canvas_pixels(page)
        height, width = image.shape[:2]
        middle = image[height // 2 - 40:height // 2 + 40, width // 2 - 40:width // 2 + 40, :3]
        assert np.abs(np.median(middle, axis=(0, 1)) - WALL_COLOUR[::-1]).max() <= 3


def test_a_rig_that_has_moved_is_said(browser):
    scenes = [Plane(50 + number, 0, 0) for number in range(20)]
    _, history = history_of(scenes, side=7, moved=lambda rig: move(rig, "focus 0.5 % longer"))
    with serving(replay(history)) as server, opened(browser, server) as page:
        cell = page.locator("#fit")
        for position, words, kind in ((3, "fit, px", "warn"), (19, "rig has moved", "bad")):
            go(page, position)
            assert cell.locator("span").inner_text() == words
            assert kind in cell.get_attribute("class")
        assert "the focus has changed by +0.5" in cell.get_attribute("title")


def test_ruler_and_polyp_through_clicks(browser, recorded, tmp_path):
    rig, history = recorded
    path = tmp_path / "measurements.csv"
    with serving(replay(history, path)) as server, opened(browser, server) as page:
        go(page, 1)
        box = page.locator("#view").bounding_box()
        surface = Surface(history.moment(1).points, history.calibration)
        marks = np.array([[110.0, 70.0], [235.0, 210.0]])
        page.keyboard.press("r")
        # The scene itself is clicked, turned to the side.
        page.keyboard.press("1")
        for place in surface.pick(marks).xyz:
            x, y, _ = page.evaluate(f"page.stage.project({place.tolist()})")
            page.mouse.click(box["x"] + x, box["y"] + y)
        until(page, "page.tools.found.length === 1")
        found = page.evaluate("page.tools.found[0]")
        true = ruler(surface, marks)
        assert np.allclose(found["points_px"], marks, atol=1.5)
        assert abs(found["length_mm"] / true.value - 1) < 0.01
        assert found["uncertainty_mm"] < 0.5 and found["frame"] == 12
        # A polyp, by points of its rim in the picture.
        page.keyboard.press("l")
        assert page.locator("#done").is_disabled()
        for u, v in true_rim(rig, HALF_SPHERE, 8):
            click_picture(page, u, v)
        page.locator("#done").click()
        until(page, "page.tools.found.length === 2")
        found = page.evaluate("page.tools.found[1]")
        assert abs(found["length_mm"] / 12 - 1) < 0.05, found
        assert abs(found["height_mm"] / 6 - 1) < 0.1 and found["size_class"] == "10-19 mm"
        assert "12." in page.locator("#message").inner_text()
        assert page.locator("#labels span").count() == 2
        # And by a circle that is dragged.
        u, v = true_rim(rig, HALF_SPHERE, 24).mean(axis=0)
        side = page.locator("#picture").bounding_box()
        scale = side["width"] / 352
        page.mouse.move(side["x"] + (u + 0.5) * scale, side["y"] + (v + 0.5) * scale)
        page.mouse.down()
        page.mouse.move(side["x"] + (u + 20) * scale, side["y"] + (v + 0.5) * scale)
        page.mouse.move(side["x"] + (u + 36.5) * scale, side["y"] + (v + 0.5) * scale)
        page.mouse.up()
        until(page, "page.tools.found.length === 3")
        assert abs(page.evaluate("page.tools.found[2].length_mm") / 12 - 1) < 0.08
        # The list leads back to the frame, and what is removed is gone, on the disk too.
        go(page, 20)
        assert page.locator("#labels span").count() == 0
        page.locator("#list li").nth(2).locator("button").first.click()
        until(page, "page.frame.position === 1")
        assert path.read_text().count("\n") == 4
        page.locator("#list li").nth(0).locator("button").nth(1).click()
        until(page, "page.tools.found.length === 2")
        assert path.read_text().count("\n") == 3
        # Where there is no surface it is said.
        page.keyboard.press("r")
        click_picture(page, 2, 2)
        click_picture(page, 100, 100)
        until(page, "document.getElementById('message').textContent.includes('no measured')")


def test_every_control_of_a_replay(browser, recorded):
    with serving(replay(recorded[1])) as server, opened(browser, server) as page:
        until(page, "page.frame")
        assert page.evaluate("page.frame.position") == 0
        assert page.locator("#laser b").inner_text() == "lit"
        found = len(recorded[1].moment(0).points)
        assert page.locator("#ok b").inner_text() == f"{found}/121"
        assert page.locator("#rate b").inner_text() == "25.0"
        assert page.locator("#chip").is_hidden()
        for key, position in (("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10)):
            page.keyboard.press(key)
            until(page, f"page.frame.position === {position}")
        page.locator("#next").click()
        until(page, "page.frame.position === 11")
        page.locator("#back").click()
        until(page, "page.frame.position === 10")
        page.locator("#time").fill("30")
        until(page, "page.frame.position === 30")
        assert page.locator("#when").inner_text() == "frame 70, 1.2 s"
        page.locator("#speed").select_option("0.1")
        page.locator("#freeze").click()
        assert page.locator("#freeze").inner_text() == "Freeze"
        page.locator("#speed").select_option("5")
        until(page, "page.frame.position === 41 && !page.playing")
        assert page.locator("#freeze").inner_text() == "Play"
        # Whatever is switched changes what is seen, and back.
        go(page, 1)
        before = canvas_pixels(page, "#picture")
        page.keyboard.press("b")
        assert (canvas_pixels(page, "#picture") != before).mean() > 0.01
        page.keyboard.press("b")
        for name in ("wire", "points", "beams", "flat"):
            before = canvas_pixels(page)
            page.locator(f"[data-toggle={name}]").click()
            assert (canvas_pixels(page) != before).any(), name
            page.locator(f"[data-toggle={name}]").click()
        for name in ("left", "top", "right", "home"):
            before = canvas_pixels(page)
            page.locator(f"[data-view={name}]").click()
            assert (canvas_pixels(page) != before).mean() > 0.02, name
        for name in ("depth", "age", "texture"):
            page.locator(f"[data-colour={name}]").click()
            assert page.locator("#legend").is_visible() == (name == "depth")
        before = canvas_pixels(page)
        page.mouse.move(400, 350)
        page.mouse.down()
        page.mouse.move(480, 380, steps=3)
        page.mouse.up()
        page.mouse.wheel(0, 240)
        assert (canvas_pixels(page) != before).any()
        theme = page.evaluate("document.documentElement.dataset.theme")
        page.locator("#theme").click()
        assert page.evaluate("document.documentElement.dataset.theme") != theme
        page.keyboard.press("?")
        assert page.locator("#keys").is_visible()
        page.locator("#keys button").click()
        with page.expect_download() as download:
            page.locator("#png").click()
        assert download.value.suggested_filename == "cyclope-12.png"
        with page.expect_download() as download:
            page.locator("#ply").click()
        assert download.value.suggested_filename == "frame-0012.ply"


@pytest.mark.parametrize("size", SIZES, ids=["laptop", "tablet", "upright"])
def test_nothing_is_cut_off_and_nothing_jumps(browser, recorded, size):
    boxes = """[...document.querySelectorAll("header, #stage, aside, footer, #picture, #list, " +
        ".cell, #freeze, #when, #time")].map((each) => { const box = each.getBoundingClientRect();
        return [box.left, box.top, box.right, box.bottom].map(Math.round); })"""
    with serving(replay(recorded[1])) as server, opened(
            browser, server, *size, color_scheme="dark", has_touch=True) as page:
        until(page, "page.frame")
        before = page.evaluate(boxes)
        assert max(right for _, _, right, _ in before) <= size[0]
        # By touch.
        page.locator("[data-tool=ruler]").tap()
        for u, v in ((110, 70), (235, 200)):
            page.touchscreen.tap(*place_in_picture(page, u, v))
        until(page, "page.tools.found.length === 1")
        go(page, 30)
        page.locator("[data-colour=depth]").click()
        assert page.evaluate(boxes) == before
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        wide = page.evaluate("""[...document.querySelectorAll("button, .button")].filter((each) =>
            each.offsetParent && each.scrollWidth > each.clientWidth + 1).map((each) => each.id)""")
        assert wide == []
        small = page.evaluate("""[...document.querySelectorAll("button, .button")].filter((each) =>
            each.offsetParent && each.getBoundingClientRect().height < 32).length""")
        assert small == 0


@contextmanager
def live(folder):
    """A live session of the simulated small rig, whose chip holds nothing yet."""
    calibration = calibrated(RIG)
    # Slower than a chip, so that it can be drawn without graphics hardware.
    with open_live("plane", RIG, speed=0.3) as terminal:
        history, reception = History(calibration), Reception(folder, calibration)
        owner = LiveChip(lambda: open_port(terminal.path), reception, history, calibration,
                          lambda: session.changed())
        session = LiveSession(owner, history, reception.folder, "simulated")
        yield session
        reception.finish()


def test_live_from_an_empty_chip_to_a_recording(browser, tmp_path):
    with live(tmp_path / "out") as session:
        # A small window: drawing without graphics hardware takes its time.
        with serving(session) as server, opened(browser, server, 800, 600) as page:
            until(page, "document.getElementById('empty').textContent.includes('start the')")
            page.locator("[data-chip=load]").click()
            until(page, "page.frame && page.following")
            until(page, "document.querySelector('#laser b').textContent === 'lit'")
            assert "recording to" in page.locator("#recording").inner_text()
            assert (tmp_path / "out" / "link.raw").stat().st_size > 1000
            # Frozen, the frame stays while others come, and live it goes on.
            until(page, "page.frame.frame >= 4")
            page.keyboard.press(" ")
            frame = page.evaluate("page.frame.frame")
            count = page.evaluate("page.state.count")
            until(page, f"page.state.count > {count + 3}")
            assert page.evaluate("page.frame.frame") == frame
            page.keyboard.press("ArrowLeft")
            until(page, f"page.frame.frame === {frame - 2}")
            page.locator("#freeze").click()
            until(page, f"page.frame.frame > {frame + 4}")
            # A second browser sees the same, and may come and go.
            with opened(browser, server, 800, 600) as other:
                until(other, "page.frame && page.following")
            page.locator("#chip summary").click()
            # The fields show what the chip has; what is typed stays until it is written.
            values = """Object.fromEntries([...document.querySelectorAll("#registers input")].map(
                (each) => [each.name, each.value]))"""
            assert page.evaluate(values) == {
                "pattern_us": "500", "texture_us": "10000", "period_us": "40000", "lit_gain": "18",
                "core_gain": "24", "dent_gain": "4", "pattern_every": "1", "points_max": "72",
                "texture_enable": "1"}
            pattern, button = page.locator("#register-pattern_us"), "#registers button"
            pattern.fill("300")
            page.locator("#register-points_max").fill("12")
            until(page, f"page.state.count > {page.evaluate('page.state.count')} + 20")
            assert pattern.input_value() == "300"
            page.locator(button).click()
            until(page, "page.frame.strip.exposure === 300 && page.frame.strip.ok === 12")
            pattern.fill("9000")
            page.locator(button).click()
            until(page, "document.getElementById('message').textContent.includes('would trip')")
            pattern.fill("")
            page.locator("#register-lit_gain").focus()
            until(page, "document.getElementById('register-pattern_us').value === '300'")
            for mode, words in (("pattern-images", "sends images"),
                                ("pattern-only", "points only")):
                page.locator(f"[data-chip={mode}]").click()
                until(page, f"""document.querySelector("#chip summary").textContent
                    === "Capsule: {words}" && page.state.doing === null""")
                assert "on" in page.locator(f"[data-chip={mode}]").get_attribute("class")
            page.locator("[data-chip=stop]").click()
            until(page, "document.querySelector('#laser span').textContent === 'stopped'"
                        " || document.getElementById('strip').classList.contains('stale')")
            until(page, "document.getElementById('strip').classList.contains('stale')")
        assert session.owner.trouble is None
        count = session.history.count
    assert read_history(tmp_path / "out" / "link.raw", session.history.calibration).count == count


def test_a_program_that_ended_is_said(browser, recorded):
    with serving(replay(recorded[1])) as server:
        page = browser.new_page()
        page.goto(server.address)
        until(page, "window.page && page.frame")
    until(page, "document.getElementById('message').textContent.includes('does not answer')")
    until(page, "document.getElementById('strip').classList.contains('stale')")
    page.close()
