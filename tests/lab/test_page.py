"""The page as people use it, in a headless browser."""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, Route, expect, sync_playwright

from exosight.lab.settings import View
from exosight.lab.system import LabSystem
from exosight.lab.views import compute_view
from exosight.vision.ood_images import draw_ood_images

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine; set CHROMIUM to its path"
)

PATIENCE = 60_000  # ms; far beyond what anything takes, also while all is compiled beside another test
expect.set_options(timeout=PATIENCE)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        # Root, as in containers, has no sandbox.
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def opener(browser: Browser, address: Any) -> Iterator[Callable[..., Page]]:
    """Open a lab and wait for its first view; what the console says, or who else is asked, fails."""
    said: list[str] = []
    contexts = []

    def listen(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            said.append(message.text)

    def asked(request: Request) -> None:
        if not request.url.startswith((str(address), "data:", "blob:")):
            said.append(request.url)

    def opened(**options: Any) -> Page:
        context = browser.new_context(accept_downloads=True, **options)
        context.set_default_timeout(PATIENCE)
        contexts.append(context)
        page = context.new_page()
        page.on("console", listen)
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", asked)
        page.goto(str(address))
        expect(page.locator("#status")).to_be_hidden()
        return page

    yield opened
    for context in contexts:
        context.close()
    # A refusal that a test provokes is told by the browser as a failed resource.
    assert [words for words in said if "status of 4" not in words] == []


@pytest.fixture
def open_page(browser: Browser, address: Any) -> Iterator[Callable[..., Page]]:
    """The published system."""
    yield from opener(browser, address)


@pytest.fixture
def open_thumb(browser: Browser, thumb_address: Any) -> Iterator[Callable[..., Page]]:
    """A system file that the network was not trained for."""
    yield from opener(browser, thumb_address)


@pytest.fixture
def open_assisted(browser: Browser, assisted_address: Any) -> Iterator[Callable[..., Page]]:
    """A system file of two channels."""
    yield from opener(browser, assisted_address)


def value_shown(page: Page) -> float:
    return float(page.locator("#value-true").inner_text().split()[0].replace("−", "-"))


def drive(page: Page, command: float, channel: str = "u") -> None:
    """Move the slider as a hand does, and wait until its view is shown."""
    page.evaluate(
        """() => {
            window.seen = new Promise((done) => document.addEventListener('shown', done, { once: true }));
        }"""
    )
    page.locator(f"#channel-{channel}").evaluate(
        "(slider, command) => { slider.value = command; slider.dispatchEvent(new Event('input')); }", command
    )
    page.evaluate("() => window.seen")


def net_force(lab: LabSystem, view: View) -> float:
    return float(compute_view(view, lab).observation.readings[lab.schema.index("F_net")])


def test_the_page_shows_the_view_it_opens_with(open_page: Callable[..., Page], lab: LabSystem) -> None:
    page = open_page()
    assert value_shown(page) == pytest.approx(net_force(lab, lab.start), abs=6e-4)
    assert page.locator("#channel-u-value").inner_text() == "2.40 N"
    readings = compute_view(lab.start, lab).observation.readings
    zones = [
        value
        for value, sensor in zip(readings, lab.schema.sensors, strict=True)
        if sensor.quantity == "contact force"
    ]
    assert page.locator("#pose svg .arrow").count() == sum(value * 100 > 0.6 for value in zones)
    assert "contact forces" in (page.locator("#pose svg").get_attribute("aria-label") or "")
    assert page.locator("#sensors th[scope=row]").count() == len(lab.schema.sensors)
    expect(page.locator("#guard")).to_have_text("normal")
    page.wait_for_selector("#path path.down")
    zone_names = [sensor.name for sensor in lab.schema.sensors if sensor.quantity == "contact force"]
    expect(page.locator("#map text")).to_have_count(len(zone_names))
    assert sorted(page.locator("#map text").all_text_contents()) == zone_names
    # From base to tip, and filled where a zone is pressed.
    places = [float(dot.get_attribute("cx") or 0) for dot in page.locator("#map circle").all()]
    assert places == sorted(places)
    filled = [float(dot.get_attribute("fill-opacity") or 0) for dot in page.locator("#map circle").all()]
    np.testing.assert_allclose(filled, np.array(zones) / max(zones), atol=1e-3)


def test_pose_and_settings_share_a_phones_screen(open_page: Callable[..., Page]) -> None:
    page = open_page(viewport={"width": 390, "height": 844})

    def box(selector: str) -> dict[str, float]:
        found = page.locator(selector).bounding_box()
        assert found is not None
        return dict(found)

    assert box("#settings")["y"] < 844
    gap = page.get_by_label("Gap at the base", exact=True)
    gap.focus()
    assert box("#pose")["y"] >= 0
    slider = gap.bounding_box()
    assert slider is not None
    assert box("#drive")["y"] + box("#drive")["height"] <= slider["y"] < 844
    zoom = page.get_by_label("Zoom, %, as a number")
    expect(zoom).to_be_hidden()
    page.locator("summary", has_text="Camera").click()
    expect(zoom).to_be_visible()
    page.wait_for_selector("#map text")
    assert box("#map text >> nth=0")["height"] >= 11  # of letters that can be read
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_what_is_said_of_a_score_agrees_with_its_digits(open_page: Callable[..., Page]) -> None:
    said = open_page().evaluate(
        """async () => {
            const { scoreWords } = await import("/svg.js");
            return [0.004, 0.996, 1, 1.0004, 1.016, 17.554].map(scoreWords);
        }"""
    )
    assert said == ["0.00", "1.00", "1.00", "1.01", "1.02", "17.56"]


def test_the_ends_of_an_axis_stand_apart(open_page: Callable[..., Page]) -> None:
    """A table as narrow as on a phone, of readings that are negative too."""
    apart, unit = open_page().evaluate(
        """async () => {
            const { sensorTable } = await import("/charts.js"), host = document.createElement("div");
            host.style.width = "300px";
            document.body.append(host);
            sensorTable(host, [{ name: "angle_1", quantity: "joint angle", unit: "rad" }],
                { truth: true, estimates: true })({ angle_1: -0.4 });
            const [left, right] = [...host.querySelectorAll(".foot text")]
                .map((each) => each.getBoundingClientRect());
            return [right.left - left.right, host.querySelector(".foot .unit").textContent];
        }"""
    )
    assert apart > 4
    assert unit == "rad"


def test_a_bent_finger_is_drawn_whole_down_to_its_skin(open_thumb: Callable[..., Page]) -> None:
    """A camera that sees 100 mm by 100 mm; the fingertip, 8 mm thick, reaches down to −43 mm."""
    below = open_thumb().evaluate(
        """async () => {
            const { scene } = await import("/scene.js"), host = document.createElement("div");
            const tube = { name: "finger", shade: 0.5, jointed: true };
            const about = { tubes: [tube], zones: [], centre: [0, 0], size: [100, 100] };
            const drawn = scene(host, { scene: about });
            drawn.draw({ tubes: [{ axis: [[0, 0], [20, -35]], radius: [10, 8] }], zones: [] });
            document.body.append(host);
            const box = host.querySelector("svg").viewBox.baseVal;
            const end = host.querySelector(".tube-edge").getBBox();
            return end.y + end.height - box.y - box.height;
        }"""
    )
    assert below <= 0


def test_dragging_up_and_down_shows_both_branches(open_page: Callable[..., Page], lab: LabSystem) -> None:
    page = open_page()
    box = page.locator("#channel-u").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.6 * box["width"], middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] - 1, middle, steps=12)
    expect(page.locator("#channel-u-value")).to_have_text("4.00 N")
    page.mouse.move(box["x"] + 0.65 * box["width"], middle, steps=12)
    page.mouse.up()
    # Up and down once; where both branches are one, the way back to rest is forgotten.
    expect(page.locator("#way")).to_have_text(re.compile(r"^0 → [234]\.\d\d → 2\.\d\d N$"))
    u = float(page.locator("#channel-u-value").inner_text().removesuffix(" N"))
    expect(page.locator("#value-true")).to_have_text(f"{net_force(lab, View(drive=((4.0,), (u,)))):.3f} N")


def test_a_system_file_has_its_own_sliders_and_sensors_and_says_why_there_are_no_estimates(
    open_thumb: Callable[..., Page], thumb: LabSystem
) -> None:
    page = open_thumb()
    page.wait_for_selector("#path path.down")
    assert [each.text_content() for each in page.locator("#sensors th[scope=row]").all()] == [
        "P1 [N]", "P2 [N]", "P3 [N]", "Fnet [N]", "knuckle [rad]"
    ]  # fmt: skip
    expect(page.locator("#no-estimates")).to_contain_text(
        "No estimates: the network was trained for the system"
    )
    expect(page.locator("#guard")).to_be_hidden()
    expect(page.locator("#map text")).to_have_count(3)
    assert sorted(page.locator("#map text").all_text_contents()) == ["P1", "P2", "P3"]
    number = page.get_by_label("sleeve young, kPa, as a number")
    number.fill("250")
    number.press("Enter")
    expect(page.locator("#command")).to_have_value(re.compile("--vary 'rods.sleeve.young=250 kPa'$"))
    view = View({"rods.sleeve.young": 250.0}, thumb.start.drive)
    expect(page.locator("#value-true")).to_have_text(f"{net_force(thumb, view):.3f} N")
    page.locator("#choices").get_by_label("Sensor").select_option("knuckle")
    expect(page.locator("#path-title")).to_have_text("knuckle over u")
    expect(page.locator("#value-true")).to_contain_text("rad")


def test_two_channels_have_two_sliders_and_either_can_be_charted(open_assisted: Callable[..., Page]) -> None:
    page = open_assisted()
    page.wait_for_selector("#path path.down")
    drive(page, 0.02, "assist")
    expect(page.locator("#channel-assist-value")).to_have_text("0.0200 N m")
    expect(page.locator("#way")).to_have_text("rest → u 2.40 N → assist 0.0200 N m")
    page.locator("#choices").get_by_label("Channel").select_option("assist")
    expect(page.locator("#falling")).to_have_text("falling from 0.0400 N m")
    page.wait_for_selector("#path path.down")
    page.get_by_role("tab", name="Closed loop").click()
    page.locator("#loop-settings").get_by_label("Sensor").select_option("P3")
    page.get_by_label("Law").select_option("proportional")
    page.get_by_role("button", name="Run").click()
    expect(page.locator("#time")).to_have_attribute("max", "59")


def test_every_slider_and_list_changes_what_it_says(open_page: Callable[..., Page]) -> None:
    page = open_page()
    commands = {page.locator("#command").input_value()}
    for family in ("sine", "cosine_sum", "sine_cosine", "legendre"):
        page.get_by_label("Family").select_option(family)
        expect(page.locator("#command")).to_have_value(re.compile(f"--vary family={family}"))
        commands.add(page.locator("#command").input_value())
    for label in ("Young's modulus, kPa, as a number", "Zoom, %, as a number"):
        number = page.get_by_label(label)
        number.fill("101" if "Zoom" in label else "410")
        number.press("Enter")
    expect(page.locator("#command")).to_have_value(re.compile("'young=410 kPa' .*--zoom 1.01"))
    page.get_by_label("Corruption").select_option("noise-high")
    expect(page.locator("#command")).to_have_value(re.compile("--corruption noise-high"))
    number = page.get_by_label("Young's modulus, kPa, as a number")
    number.fill("99999")
    number.press("Enter")
    expect(number).to_have_value("1000")  # the nearest that is allowed
    assert len(commands) == 5


def test_files_and_the_command_can_be_saved(open_page: Callable[..., Page], tmp_path: Path) -> None:
    page = open_page()
    for button, start in (
        ("#save-figure", b"<svg"),
        ("#save-picture", b"\x89PNG"),
        ("#save-pose", b"tube,node,x [m],y [m],z [m],radius [m]\nfinger,0,"),
        ("#save-readings", b"sensor,"),
        ("#save-path", b"u [N],"),
    ):
        with page.expect_download() as waiting:
            page.locator(button).click()
        file = tmp_path / waiting.value.suggested_filename
        waiting.value.save_as(file)
        assert file.read_bytes().startswith(start)
    assert (tmp_path / "exosight-pose.svg").read_text().count("var(") == 0
    assert page.locator("#command").input_value() == "exosight lab --system published"


def test_a_loop_runs_plays_pauses_and_is_scrubbed(open_page: Callable[..., Page], tmp_path: Path) -> None:
    page = open_page()
    page.get_by_role("tab", name="Closed loop").click()
    page.get_by_label("Law").select_option("proportional")
    page.get_by_label("Measured by").select_option("true")
    page.get_by_role("button", name="Run").click()
    expect(page.locator("#time")).to_have_attribute("max", "59")
    # Wherever it is now: the key moves the time, and moving it pauses.
    page.locator("#time").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#play")).to_have_text("Play")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Pause")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Play")
    page.locator("#time").focus()
    page.keyboard.press("End")
    expect(page.locator("#time-value")).to_have_text("5.9 s")
    expect(page.locator("#loop-target")).to_have_text("0.000 N")
    page.keyboard.press("Home")
    expect(page.locator("#loop-u")).to_have_text("0.00 N")
    with page.expect_download() as waiting:
        page.locator("#save-run").click()
    waiting.value.save_as(tmp_path / "run.csv")
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 61


def test_a_newer_run_takes_the_place_of_one_that_plays(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.get_by_role("tab", name="Closed loop").click()
    page.get_by_label("Law").select_option("proportional")
    page.get_by_label("Measured by").select_option("true")
    run = page.locator("#loop-settings button")
    run.click()
    expect(page.locator("#loop-u")).to_have_text(re.compile("[1-9].* N"))
    expect(page.locator("#play")).to_have_text("Pause")
    page.route("**/api/trial", lambda route: None)  # not answered
    run.click()
    for name in ("loop-u", "loop-true", "loop-guard", "time-value"):
        expect(page.locator(f"#{name}")).to_have_text("–")
    expect(page.locator("#play")).to_be_disabled()
    page.unroute("**/api/trial")
    run.click()
    expect(page.locator("#play")).to_have_text("Pause")
    expect(page.locator("#loop-u")).to_have_text(re.compile("[1-9].* N"))
    expect(page.locator("#loop-guard")).to_have_text("no guard")


def test_the_address_keeps_the_settings_and_their_history(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.get_by_label("Family").select_option("sine")
    expect(page).to_have_url(re.compile("#design.family=sine&drive=2.4$"))
    zoom = page.get_by_label("Zoom, %, as a number")
    zoom.fill("104")
    zoom.press("Enter")
    expect(page).to_have_url(re.compile("camera.zoom=1.04"))
    page.get_by_role("tab", name="Closed loop").click()
    page.get_by_label("Law").select_option("proportional")
    target = page.get_by_label("Target F_net, N, as a number")
    target.fill("0.21")
    target.press("Enter")
    expect(page).to_have_url(re.compile("#tab=loop&.*loop.target=0.21&loop.law=proportional&drive=2.4$"))
    page.reload()
    expect(page.locator("#command")).to_have_value(
        "exosight lab --system published --vary family=sine --zoom 1.04"
    )
    expect(page.get_by_label("Law")).to_have_value("proportional")
    expect(target).to_have_value("0.21")
    page.go_back()
    expect(page.locator("#explore")).to_be_visible()
    page.go_back()
    expect(page.locator("#command")).to_have_value("exosight lab --system published --vary family=sine")
    expect(zoom).to_have_value("100")
    page.go_forward()
    expect(zoom).to_have_value("104")
    expect(page.locator("#stale")).to_be_hidden()


@pytest.mark.parametrize("typed", ["before", "after"])
def test_limits_that_arrive_late_leave_a_number_that_is_being_typed(
    typed: str, open_page: Callable[..., Page]
) -> None:
    page = open_page()
    page.wait_for_selector("#path path.down")  # no request of the first tab is held below
    held: list[Route] = []
    page.route("**/api/path", lambda route: held.append(route))
    with page.expect_request("**/api/path"):
        page.get_by_role("tab", name="Closed loop").click()
    target = page.get_by_label("Target F_net, N, as a number")
    expect(target).to_have_attribute("max", "1")
    target.select_text()
    if typed == "before":
        page.keyboard.type("0.21")
    held[0].continue_()
    expect(target).not_to_have_attribute("max", "1")
    if typed == "after":
        page.keyboard.type("0.21")
    expect(target).to_have_value("0.21")
    target.press("Enter")
    expect(page).to_have_url(re.compile("loop.target=0.21"))
    page.locator("#loop-settings").get_by_label("Sensor").select_option("C6")
    expect(page.get_by_label("Target C6, N, as a number")).to_have_count(1)


def test_an_address_that_does_not_fit_is_told_and_left(open_page: Callable[..., Page], address: Any) -> None:
    page = open_page()
    for text, words in {
        "design.family=bogus": "design.family: expected one of linear, sine",
        "design.__proto__=1": "design.__proto__: there is no such setting of published",
        "design.length=NaN": "design.length: expected",
        "drive=99": "drive, u: expected 0 to 4, got",
        "drive=2.4_1": "drive: expected 1 commands",
        "drive=2.403": "drive, u: expected multiples of 0.05",
        "&".join(["drive=1"] * 65): "drive: expected at most 64 stops",
        "loop.gain=1e999": "loop.gain: expected",
        "<img src=x onerror=alert(1)>": "there is no such setting",
        "x" * 9000: "expected at most 8000 characters",
    }.items():
        page.goto(f"{address}/#{text}")
        expect(page.locator("#stale")).to_contain_text(words)
    expect(page).to_have_url(f"{address}/")
    expect(page.locator("#command")).to_have_value("exosight lab --system published")
    page.get_by_label("Family").select_option("sine")
    expect(page.locator("#stale")).to_be_hidden()


def test_a_token_does_not_stay_in_the_address(browser: Browser, guarded_address: Any) -> None:
    page = browser.new_page()
    for _ in range(2):  # the second time the cookie is there already
        page.goto(f"{guarded_address}/?token=secret#camera.zoom=1.04&drive=2.4")
        expect(page.locator("#status")).to_be_hidden()
        expect(page).to_have_url(f"{guarded_address}/#camera.zoom=1.04&drive=2.4")
    page.close()


@pytest.mark.parametrize("kind", ["png", "tiff"])  # browsers do not show TIFF
def test_a_part_of_an_image_of_other_proportions_is_estimated(
    open_page: Callable[..., Page], lab: LabSystem, kind: str
) -> None:
    page = open_page(viewport={"width": 390, "height": 844})
    page.get_by_role("tab", name="Image upload").click()
    image = np.full((480, 640), 235, np.uint8)
    image[100:420, 40:360] = cv2.resize(
        compute_view(lab.start, lab).image, (320, 320), interpolation=cv2.INTER_NEAREST
    )
    data = cv2.imencode(f".{kind}", image)[1].tobytes()
    page.locator("#file").set_input_files(
        {"name": f"wide.{kind}", "mimeType": f"image/{kind}", "buffer": data}
    )
    frame = page.locator("#frame")
    expect(frame).to_have_attribute(
        "aria-label", "Crop of 480 by 480 pixels, 80 from the left, 0 from the top"
    )
    expect(page.locator("#result")).to_be_hidden()
    shown = page.locator("#whole").bounding_box()
    assert shown is not None
    pixel = shown["width"] / 640

    def drag(x: float, y: float, to_x: float, to_y: float) -> None:
        assert shown is not None
        page.mouse.move(shown["x"] + x * pixel, shown["y"] + y * pixel)
        page.mouse.down()
        page.mouse.move(shown["x"] + to_x * pixel, shown["y"] + to_y * pixel, steps=3)
        page.mouse.up()

    drag(550, 470, 390, 310)  # its corner
    drag(200, 100, 160, 200)
    # A pixel of the page is nearly two of the image.
    left, top, side = (int(re.findall(r"\d+", frame.get_attribute("aria-label") or "")[i]) for i in (2, 3, 0))
    np.testing.assert_allclose((left, top, side), (40, 100, 320), atol=2)
    frame.focus()
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("Shift+ArrowLeft")
    expect(frame).to_have_attribute("aria-label", re.compile(" 0 from the left"))
    for _ in range(7):
        page.keyboard.press("ArrowRight")
    for _ in range(5):
        page.keyboard.press("+")
        page.keyboard.press("-")
    page.get_by_role("button", name="Estimate this crop").click()
    expect(page.locator("#verdict")).to_contain_text("of an error of F_net above 0.05 N")
    estimated = float(page.locator("#verdict").inner_text().split()[1])
    assert estimated == pytest.approx(net_force(lab, lab.start), abs=0.03)


def test_a_picture_is_estimated_when_it_is_dropped(open_page: Callable[..., Page], lab: LabSystem) -> None:
    page = open_page()
    page.get_by_role("tab", name="Image upload").click()
    files = {"pose.png": compute_view(lab.start, lab).image, "text.png": draw_ood_images("text", 1, 0)[0]}
    for name, image in files.items():
        data = cv2.imencode(".png", image)[1].tobytes()
        dropped = page.evaluate_handle(
            """([name, bytes]) => { const files = new DataTransfer();
                files.items.add(new File([new Uint8Array(bytes)], name)); return files; }""",
            [name, list(data)],
        )
        page.dispatch_event("#drop", "drop", {"dataTransfer": dropped})
        words = "of an error of F_net above 0.05 N" if name == "pose.png" else "Do not trust these"
        expect(page.locator("#verdict")).to_contain_text(words)
    page.locator("#file").set_input_files(
        {"name": "bad.png", "mimeType": "image/png", "buffer": b"not a picture"}
    )
    expect(page.locator("#file-problem")).to_contain_text("that can be read")
    expect(page.locator("#result")).to_be_hidden()
    page.locator("#file").set_input_files(
        {"name": "large.png", "mimeType": "image/png", "buffer": bytes(9 * 2**20)}
    )
    expect(page.locator("#file-problem")).to_contain_text("at most 8 MiB")
    np.testing.assert_equal(page.get_by_role("tab", name="Explore").is_enabled(), True)


def test_the_page_is_usable_by_keyboard_alone(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "tab-explore"
    page.keyboard.press("ArrowRight")
    expect(page.locator("#loop")).to_be_visible()
    page.keyboard.press("Home")
    expect(page.locator("#explore")).to_be_visible()
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        name = page.evaluate(
            "document.activeElement.id || document.activeElement.getAttribute('aria-label') || ''"
        )
        if name == "channel-u" and name not in reached:
            page.keyboard.press("ArrowRight")
            expect(page.locator("#channel-u-value")).to_have_text("2.45 N")
            page.keyboard.press("End")
            expect(page.locator("#channel-u-value")).to_have_text("4.00 N")
        reached.add(name)
    assert {
        "channel-u",
        "sweep",
        "theme",
        "command",
        "copy",
        "save-figure",
        "Length, mm, as a number",
    } <= reached
    slider = page.get_by_label("Radius at the tip", exact=True)
    slider.focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_label("Radius at the tip, mm, as a number")).to_have_value("5.1")


def test_a_server_that_is_gone_is_told(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.route(
        "**/api/view", lambda route: route.fulfill(status=400, body=json.dumps({"error": "length: too long"}))
    )
    drive(page, 3.0)
    expect(page.locator("#problem")).to_have_text("length: too long")
    page.unroute("**/api/view")
    drive(page, 2.0)
    expect(page.locator("#problem")).to_be_hidden()


@pytest.mark.parametrize("name", ["open_page", "open_thumb", "open_assisted"])
@pytest.mark.parametrize(("scheme", "size"), [("light", (1400, 900)), ("dark", (390, 844))])
def test_axe_finds_no_serious_fault(
    name: str, scheme: str, size: tuple[int, int], request: pytest.FixtureRequest
) -> None:
    # Without motion: a colour on its way from one to the other is nobody's choice.
    viewport = {"width": size[0], "height": size[1]}
    page = request.getfixturevalue(name)(color_scheme=scheme, reduced_motion="reduce", viewport=viewport)
    page.wait_for_selector("#path path.down")
    for tab in ("Explore", "Closed loop", "Image upload"):
        page.get_by_role("tab", name=tab).click()
        found = Axe().run(page).response["violations"]
        assert [
            (each["id"], each["nodes"][0]["html"])
            for each in found
            if each["impact"] in ("serious", "critical")
        ] == []
        # Nothing has to be scrolled sideways.
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]


def test_the_theme_is_chosen_and_kept(open_page: Callable[..., Page]) -> None:
    page = open_page(color_scheme="light")
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    for words in ("Theme: light", "Theme: dark"):
        page.locator("#theme").click()
        expect(page.locator("#theme")).to_have_text(words)
    assert page.evaluate(ground) != light
    page.reload()
    expect(page.locator("#theme")).to_have_text("Theme: dark")
    assert page.evaluate(ground) != light
