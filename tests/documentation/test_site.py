"""The site builds without a warning, loads nothing from elsewhere, and its links lead somewhere."""

from __future__ import annotations

import html
import inspect
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytest.importorskip("mkdocs", reason="the site needs an extra: pip install 'cutenv[docs]'")

from cutenv.commands.cli import COMMANDS, RIG_COMMANDS
from cutenv.records.scoring import METRICS
from scripts.documentation import environment_pages

LOADING = {"audio", "embed", "iframe", "img", "link", "object", "script", "source", "track", "video"}


class Page(HTMLParser):
    """Resources, links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.anchors |= {named[name] for name in ("id", "name") if name in named}
        if tag in LOADING:
            self.loads += [named[name] for name in ("href", "src", "data", "srcset", "poster") if name in named]
        if tag == "a" and "href" in named:
            self.links.append(named["href"])


@pytest.fixture(scope="module")
def texts(site: Path) -> dict[Path, str]:
    return {path: path.read_text(encoding="utf-8") for path in sorted(site.rglob("*.html"))}


@pytest.fixture(scope="module")
def pages(texts: dict[Path, str]) -> dict[Path, Page]:
    return {path: Page(text) for path, text in texts.items()}


def loaded_from_elsewhere(text: str, loads: list[str]) -> list[str]:
    """Return every address in a page or style sheet that a browser would fetch from another machine."""
    in_styles = re.findall(r"(?:url\(\s*|@import\s+)[\"']?([^\"')\s;]+)", text)
    found = [*loads, *in_styles]
    return [each for each in found if re.match(r"(?:[a-z]+:)?//", each) and not each.startswith(("data:", "file:"))]


def broken_links(path: Path, page: Page, all_pages: dict[Path, Page]) -> list[str]:
    """Return the internal links of a page whose file or anchor is missing."""
    broken = []
    for link in dict.fromkeys(page.links):
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
        if target.is_dir():
            target /= "index.html"
        anchor = unquote(parts.fragment)
        known = all_pages.get(target)
        if not target.is_file() or (anchor and known is not None and anchor not in known.anchors):
            broken.append(link)
    return broken


def test_no_page_loads_anything_from_elsewhere(site: Path, texts: dict[Path, str], pages: dict[Path, Page]) -> None:
    assert len(texts) > 60
    found = {str(path): loaded_from_elsewhere(text, pages[path].loads) for path, text in texts.items()}
    sheets = list(site.rglob("*.css"))
    assert sheets
    found |= {str(path): loaded_from_elsewhere(path.read_text(encoding="utf-8"), []) for path in sheets}
    assert {path: addresses for path, addresses in found.items() if addresses} == {}


@pytest.mark.parametrize(
    "text",
    [
        '<script src="https://unpkg.com/x.js"></script>',
        '<link rel="stylesheet" href="//fonts.googleapis.com/css">',
        "<style>@import 'https://x.org/a.css';</style>",
        "body { background: url(https://x.org/a.png) }",
    ],
)
def test_something_from_elsewhere_is_noticed(text: str) -> None:
    assert len(loaded_from_elsewhere(text, Page(text).loads)) == 1


def test_links_and_anchors_lead_somewhere(site: Path, pages: dict[Path, Page]) -> None:
    shown = {path: page for path, page in pages.items() if path.name != "404.html"}  # its links begin at the server
    broken = {str(path.relative_to(site)): broken_links(path, page, pages) for path, page in shown.items()}
    assert {path: links for path, links in broken.items() if links} == {}


@pytest.mark.parametrize("link", ["nowhere.html", "index.html#nowhere", "#nowhere"])
def test_a_broken_link_is_noticed(link: str, tmp_path: Path) -> None:
    path = tmp_path / "index.html"
    path.write_text(f'<a id="here" href="#here">fine</a> <a href="{link}">broken</a>')
    page = Page(path.read_text())
    assert broken_links(path, page, {path: page}) == [link]


def test_every_equation_is_mathml(texts: dict[Path, str]) -> None:
    assert not [path for path, text in texts.items() if 'class="arithmatex"' in text]
    equations = [each for text in texts.values() for each in re.findall(r"<math\b.*?</math>", text, re.DOTALL)]
    assert len(equations) > 10
    assert not [each for each in equations if "\\" in each], "a command that the converter does not know"


def test_every_command_has_its_page(site: Path) -> None:
    names = [*COMMANDS, *(f"rig {name}" for name in RIG_COMMANDS)]
    for name in names:
        text = (site / "reference" / "commands" / f"{name.replace(' ', '-')}.html").read_text(encoding="utf-8")
        assert f"usage: cutenv {name}" in text


@pytest.mark.parametrize("page", environment_pages.IDS)
def test_an_environments_page_lists_every_argument(site: Path, page: str) -> None:
    environment_id = environment_pages.IDS[page]
    text = (site / "environments" / f"{page}.html").read_text(encoding="utf-8")
    assert f'gymnasium.make("{environment_id}")' in html.unescape(re.sub(r"<[^>]+>", "", text))
    shown = environment_pages.environment_class(environment_id)
    own = getattr(shown, "option_names", shown.options_class.names)
    arguments = inspect.signature(shown).parameters.values()
    named = set(own) or {each.name for each in arguments if each.kind is inspect.Parameter.KEYWORD_ONLY}
    assert len(named) >= {"path-cut": 5, "free-cut": 5, "rig-path-cut": 5}.get(page, 8)
    assert named - {"render_mode"} <= set(re.findall(r"<(?:td|code)>([^<]*)</(?:td|code)>", text))
    assert not re.search(r"={3,} ={3,}", text), "a table that was not turned into one"


def test_the_python_api_shows_functions_with_their_arguments(site: Path) -> None:
    text = (site / "reference" / "api" / "records.scoring.html").read_text(encoding="utf-8")
    assert 'id="cutenv.records.scoring.score"' in text
    assert ":class:`" not in text
    for name in METRICS:
        assert name in (site / "reference" / "metrics.html").read_text(encoding="utf-8")
