"""The page as a browser shows it: it loads, moves as the record says, can be read; needs Debian's ``chromium``."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from view_pages import INSTANTS, document, shown, told

from scripts.browsers.chromium import LEAST_CONTRAST, Browser

pytest.importorskip("meshcat", reason="the 3-D viewer is an extra: pip install 'cutenv[view3d]'")

from cutenv.display.viewer.solid.solids import SlabSolid, pose
from cutenv.display.viewer.solid.view_page import view_page

pytestmark = pytest.mark.needs("chromium")

DESK, PHONE = 1000, 390
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 50))))"
UNITS = 10.0  # of the scene in a metre


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "view.html"
    path.write_text(document(), encoding="utf-8")
    return path


@pytest.fixture
def desk(browser: Browser, page: Path) -> Browser:
    """The browser with the page on a desk; opened anew only where another was opened in between."""
    there = browser.value("[location.href, innerWidth, matchMedia('(prefers-color-scheme: dark)').matches]")
    if there != [page.as_uri(), DESK, False]:
        browser.open(page, DESK)
    return browser


def slide(browser: Browser, i: int) -> None:
    """Do as a hand at the slider does, and wait until it is drawn."""
    browser.value(
        f"(slider => {{ slider.value = {i}; slider.dispatchEvent(new Event('input')) }})"
        "(document.getElementById('slider'))"
    )
    browser.value(DRAWN)


def picture(browser: Browser) -> np.ndarray:
    """The picture of the scene alone, shape (height, width, 3), 0 to 1; labels and legend hidden."""
    from matplotlib.image import imread

    browser.value("document.querySelectorAll('#labels, #legend').forEach(part => part.style.visibility = 'hidden')")
    browser.value(DRAWN)
    shot = base64.b64decode(browser.tell("Page.captureScreenshot")["data"])
    browser.value("document.querySelectorAll('#labels, #legend').forEach(part => part.style.visibility = '')")
    box = browser.value("(b => [b.top, b.bottom, b.left, b.right])(cutView.viewer.dom_element.getBoundingClientRect())")
    top, bottom, left, right = (round(edge) for edge in box)
    return np.asarray(imread(io.BytesIO(shot))[top:bottom, left:right, :3])


def vertices(browser: Browser, path: str) -> np.ndarray:
    """Of a surface in the scene [m], shape (n, 3)."""
    found = browser.value(f"Array.from(cutView.node('{path}/<object>').geometry.attributes.position.array)")
    return np.array(found).reshape(-1, 3) / UNITS


def check_loads(browser: Browser, page: Path) -> None:
    """The browser asked for the file alone, and neither it nor a script complained."""
    assert [address for address in browser.requests() if not address.startswith(("data:", "blob:"))] == [page.as_uri()]
    assert browser.complaints() == []
    assert browser.errors() == []
    assert browser.value("typeof cutView") == "object"
    assert browser.value("document.getElementById('trouble').hidden")


def check_scalpel(browser: Browser, i: int) -> None:
    """It stands where the record has the blade, at the record's angle and depth."""
    cut = shown()
    depth = float(cut.depth.at(cut.position[i]))
    expected = pose(float(cut.position[i]), float(cut.angle[i]), depth)
    x, y, z = (v / UNITS for v in browser.value("cutView.node('scalpel').position.toArray()"))
    assert (x, y, z) == pytest.approx((0.0, expected.along, expected.height), abs=2e-6)
    turned = browser.value("cutView.node('scalpel').rotation.toArray().slice(0, 3)")
    assert turned == pytest.approx([expected.angle - np.pi / 2, 0.0, 0.0], abs=2e-5)


def check_moves(browser: Browser) -> None:
    """Two places of the slider are two pictures, and one place is the same picture again."""
    pictures = []
    for i in (5, 25, 5):
        slide(browser, i)
        pictures.append(picture(browser))
    first, second, again = pictures
    assert (np.abs(first - second).max(axis=2) > 0.1).mean() > 0.01
    assert (np.abs(first - again).max(axis=2) > 0.1).mean() < 1e-3


def check_labels(browser: Browser) -> None:
    """What is shown has its name beside it, within the picture."""
    found: list[Any] = browser.value(
        "[...document.querySelectorAll('.label')].filter(each => !each.hidden).map(each => {"
        " const b = each.getBoundingClientRect(), s = document.getElementById('stage').getBoundingClientRect();"
        " const inside = b.left >= s.left && b.right <= s.right && b.top >= s.top && b.bottom <= s.bottom;"
        " return [each.textContent, inside]; })"
    )
    names = {"target 80 mm", "clamp", "tip (from return stroke)", "cut drawn open: illustration"}
    assert names | {f"{shown().force[25]:.2f} N"} == {text for text, _ in found}
    assert all(inside for _, inside in found)


@pytest.mark.parametrize("width", [DESK, PHONE])
def test_the_page_loads_fits_and_can_be_read(browser: Browser, page: Path, width: int) -> None:
    """In the light and, as one sees who changes the colours of the screen, in the dark."""
    browser.open(page, width)
    for dark in (False, True):
        browser.darken(dark)
        slide(browser, 25)
        check_loads(browser, page)
        check_labels(browser)
        assert browser.value("innerWidth") == width
        assert browser.value("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert browser.value(LEAST_CONTRAST) >= 4.5
        assert browser.value("matchMedia('(prefers-color-scheme: dark)').matches") is dark
    assert browser.value("document.title") == f"{shown().name} in 3-D"


def test_the_slider_moves_the_scene(desk: Browser) -> None:
    check_moves(desk)


def test_the_scalpel_moves_as_the_record_says(desk: Browser) -> None:
    for i in (0, 10, 25, INSTANTS - 1):
        slide(desk, i)
        check_scalpel(desk, i)


def test_the_tissue_moves_as_the_field_says(desk: Browser) -> None:
    solid = SlabSolid(shown())
    for i in (0, 25):
        slide(desk, i)
        points = solid.lattices["top"].points
        expected = solid.rest.copy()
        expected[:, :2] += solid.displacement(i)
        np.testing.assert_allclose(vertices(desk, "tissue/top"), expected[points], atol=2e-6)


def test_the_arrow_is_as_long_as_the_force_and_points_to_the_clamp(desk: Browser) -> None:
    i = int(np.argmax(shown().force))
    slide(desk, i)
    ends = desk.value(
        "(() => { cutView.viewer.scene.updateMatrixWorld(true); const b = new MeshCat.THREE.Box3();"
        " b.setFromObject(cutView.node('arrow')); return [b.min.z, b.max.z]; })()"
    )
    assert (ends[1] - ends[0]) / UNITS == pytest.approx(0.01 * shown().force[i], abs=2e-4)
    along = [-edge / UNITS for edge in ends]  # three's z runs toward the clamp
    assert min(along) < shown().position[i] - 0.01


def test_the_readout_tells_the_instant(desk: Browser) -> None:
    slide(desk, 25)
    cut = shown()
    told_now = desk.value("[...document.querySelectorAll('#readout dd')].map(each => each.textContent)")
    assert told_now == [
        f"{cut.time[25]:.2f} s",
        f"{cut.force[25]:.2f} N",
        f"{1e2 * cut.speed[25]:.2f} cm/s",
        "60°",
        f"{1e3 * cut.position[25]:.1f} mm",
        f"{1e3 * cut.tip[25]:.1f} mm",
    ]


def test_it_plays_to_the_end_and_stops(desk: Browser) -> None:
    slide(desk, INSTANTS - 4)
    desk.value("document.getElementById('pace').value = '4'")
    desk.value("document.getElementById('play').click()")
    assert desk.value("document.getElementById('play').textContent") == "pause"
    ended = (
        "new Promise((done, fail) => { const start = Date.now(), byId = name => document.getElementById(name);"
        " const look = () => { if (byId('play').textContent === 'play') done(Number(byId('slider').value));"
        " else if (Date.now() - start > 60000) fail(new Error('still playing')); else setTimeout(look, 50); };"
        " look(); })"
    )
    assert desk.value(ended) == INSTANTS - 1


def test_tissue_can_be_seen_through(desk: Browser) -> None:
    slide(desk, 25)
    before = picture(desk)
    desk.value("document.getElementById('see-through').click()")
    after = picture(desk)
    desk.value("document.getElementById('see-through').click()")
    assert (np.abs(before - after).max(axis=2) > 0.05).mean() > 0.05


def test_colours_are_those_of_the_legend(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "energy.html"
    path.write_text(document("energy"), encoding="utf-8")
    browser.open(path, DESK)
    i = int(np.argmax([SlabSolid(shown()).amount(k, "energy").max() for k in range(INSTANTS)]))
    slide(browser, i)
    colours = np.array(browser.value("Array.from(cutView.node('tissue/top/<object>').geometry.attributes.color.array)"))
    darkest = colours.reshape(-1, 3)[SlabSolid(shown()).amount(i, "energy").argmax()]
    assert 255 * darkest == pytest.approx(told(document("energy"))["palette"][-1], abs=0.01)


def test_without_a_target_the_page_loads_too(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "bare.html"
    path.write_text(view_page(shown(None)), encoding="utf-8")
    browser.open(path, PHONE)
    check_loads(browser, path)
    assert browser.value("document.getElementById('label-target').hidden")


def test_a_browser_without_graphics_says_so(page: Path, tmp_path: Path, browser: Browser) -> None:
    # No canvas gives a WebGL context, as where graphics are turned off.
    source = "HTMLCanvasElement.prototype.getContext = () => null"
    script = browser.tell("Page.addScriptToEvaluateOnNewDocument", source=source)["identifier"]
    try:
        browser.open(page, DESK)
        assert "WebGL" in browser.value("document.getElementById('trouble').innerText")
        assert browser.errors() != []
    finally:
        browser.tell("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
