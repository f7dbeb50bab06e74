"""A trainee's way in a class, from code to card, on a telephone: by keys or fingers alone, dark, in German."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from opened_page import Browser, by_finger, by_keys, fits_and_can_be_read, lead_to_the_end, wait

from cutenv.people.classroom import ClassStore
from scripts.validation.classroom.class_load import Served

WIDTH, HEIGHT = 390, 844
COURSE = """name = "kurz"
[[task]]
name = "Leber"
specimen_class = "liver"
target_length_mm = 20
mark = { overall_score = 100 }
"""
ENGLISH = re.compile(r"\b(the|of|is|are|with|cuts?|score|not|your|and|too|force|blade)\b", re.IGNORECASE)
SHOWN = "[document.title, document.body.innerText].join(' ')"
FOCUS = "document.activeElement.id || document.activeElement.name || document.activeElement.className"
PLACE = """((found, above) => {
  if (above) found.scrollIntoView({ block: "center" });
  return (r => [r.left + r.width / 2, r.top + r.height / 2])(found.getBoundingClientRect());
})(document.querySelector('%s'), %s)"""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A class of short cuts for every trainee; each leaves it at the end."""
    folder = tmp_path_factory.mktemp("served")
    course = folder / "course.toml"
    course.write_text(COURSE, encoding="utf-8")
    server = Served(folder / "class", "--language", "de", "--course", str(course))
    yield server
    server.end()


def press(page: Browser, *keys: str) -> None:
    for key in keys:
        page.press(key)
        page.release(key)


def tab_to(page: Browser, name: str) -> None:
    for _ in range(40):
        if page.value(FOCUS) == name:
            return
        press(page, "Tab")
    raise AssertionError(f"no way by Tab to {name}")


def tap(page: Browser, selector: str) -> None:
    page.stroke([tuple(page.value(PLACE % (selector, "true")))])


def keys_go(page: Browser, name: str, _selector: str, key: str = "Enter") -> None:
    tab_to(page, name)
    press(page, key)
    if page.name == "Firefox":  # whose protocol sends keys to a control, but lets them do nothing there
        page.value("document.activeElement.click()")


def fingers_go(page: Browser, _name: str, selector: str, key: str = "") -> None:
    tap(page, selector)


def look(page: Browser) -> None:
    fits_and_can_be_read(page, WIDTH)
    assert page.value("matchMedia('(prefers-color-scheme: dark)').matches")
    broken = page.value("[...document.querySelectorAll('button')].filter(each => each.offsetHeight > 120).length")
    assert not broken, "a button is broken between its letters"
    shown = page.value(SHOWN)
    assert not ENGLISH.search(shown.replace("English", "")), (ENGLISH.search(shown), shown)


@pytest.mark.parametrize(("go", "device"), [(keys_go, by_keys), (fingers_go, by_finger)])
def test_a_trainee_comes_from_the_code_to_the_card(
    browser: Browser, served: Served, go: Callable[..., None], device: Callable[..., Any]
) -> None:
    page = browser
    store = ClassStore(f"sqlite:///{served.folder / 'class.db'}")
    (code,) = store.add_codes(1)
    store.close()
    page.open(served.address, WIDTH, HEIGHT, dark=True)
    wait(page, "document.activeElement?.name === 'code'")
    look(page)
    press(page, *code)
    go(page, "consent", "[name=consent]", " ")
    wait(page, "document.querySelector('[name=consent]').checked")
    go(page, "first", "button.first")
    wait(page, "Boolean(window.cutenvPage?.page?.cut)")
    look(page)
    go(page, "start", "#start")
    wait(page, "cutenvPage.page.phase === 'cutting'")
    assert page.value(FOCUS) == "picture"
    look(page)
    lead_to_the_end(page, device(page, *page.value(PLACE % ("#picture", "false"))))
    wait(page, "document.getElementById('kept').textContent && !cutenvPage.page.busy")
    assert page.value("cutenvPage.page.cut.end") == "finished"
    if device is by_keys:  # a finger that is still on the picture takes the focus back there
        assert page.value(FOCUS) == "card"
    look(page)
    assert page.value("document.querySelectorAll('#tries li').length") >= 1
    go(page, "watch", "#watch")
    wait(page, "cutenvPage.page.replay?.cut.count > 50")
    look(page)
    go(page, "end-replay", "#end-replay")
    wait(page, "document.querySelectorAll('#history tr').length === 2")
    look(page)
    go(page, "start", "#start")  # the next specimen
    wait(page, "cutenvPage.page.phase === 'cutting' && document.getElementById('card').hidden")
    assert page.errors() == []
    assert [each for each in page.complaints() if "favicon.ico" not in each] == []  # Firefox looks for one
    page.value("document.querySelector('form[action=leave] button').click()")  # the next one has another code
    wait(page, "document.activeElement?.name === 'code'")
