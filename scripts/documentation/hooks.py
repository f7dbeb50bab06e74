"""Hooks of MkDocs: pages made of the package itself, pictures, and equations as MathML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from cutenv.people.browser.page_alone import page_alone
from scripts import ROOT
from scripts.documentation import api_pages, check_pages, command_pages, environment_pages
from scripts.documentation.equations import as_mathml

GENERATED = "GENERATED "

_INTERVAL = re.compile(r"(<td[^>]*>[^<\[]*)(\[[-+\d., ]+\])(</td>)")
_generated: dict[str, str] = {}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Make the pages, and list them where the navigation asks for a folder of them."""
    titled = [*command_pages.pages(), *api_pages.pages()]
    _generated.clear()
    _generated.update({path: text for path, _, text in titled})
    _generated.update([*environment_pages.pages(), *check_pages.pages()])
    examples = sorted(
        Path(config.docs_dir, "examples").glob("*.md"), key=lambda page: (page.stem != "index", page.stem)
    )
    entries: list[tuple[str, str | None]] = [(path, title) for path, title, _ in titled]
    entries += [(f"examples/{path.name}", None) for path in examples]
    config.nav = _filled(config.nav, entries)
    return config


def _filled(nav: Any, entries: list[tuple[str, str | None]]) -> Any:
    """Return a part of the navigation with ``GENERATED <folder>`` replaced by the pages of the folder."""
    if isinstance(nav, list):
        return [_filled(entry, entries) for entry in nav]
    if isinstance(nav, dict):
        return {title: _filled(entry, entries) for title, entry in nav.items()}
    if not nav.startswith(GENERATED):
        return nav
    folder = nav.removeprefix(GENERATED)
    return [{title: path} if title else path for path, title in entries if Path(path).parent.as_posix() == folder]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that were made, those that cut, and the pictures of ``assets/pictures``."""
    files.append(File.generated(config, "cut.html", content=page_alone()))
    files.append(File.generated(config, "cut-depth.html", content=page_alone(tasks=("depth",), count=2)))
    files.append(
        File.generated(
            config, "cut-path.html", content=page_alone(tasks=("path",), count=4, specimen_classes=("liver",))
        )
    )
    for path, text in _generated.items():
        files.append(File.generated(config, path, content=text))
    for picture in sorted((ROOT / "assets" / "pictures").iterdir()):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_content(html: str, **_: Any) -> str:
    """Turn equations into MathML, and keep the interval that follows a value in a table on one line."""
    return _INTERVAL.sub(r'\1<span class="interval">\2</span>\3', as_mathml(html))


def on_post_build(config: MkDocsConfig) -> None:
    """Leave out what no page loads."""
    for pattern in ("assets/javascripts/lunr/**/*.js", "assets/**/*.map"):
        for path in Path(config.site_dir).glob(pattern):
            path.unlink()
