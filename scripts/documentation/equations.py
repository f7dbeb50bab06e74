"""Equations of the documentation as MathML, so that a page needs no script and no fonts from elsewhere."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_EQUATION = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<open>[(\[])(?P<latex>.*?)\\[)\]]</(?P=tag)>', re.DOTALL
)


def as_mathml(page: str) -> str:
    """Replace every equation that ``pymdownx.arithmatex`` has marked in a page's HTML by MathML."""
    return _EQUATION.sub(_replacement, page)


def _replacement(match: re.Match[str]) -> str:
    block = match["open"] == "["
    mathml = convert(html.unescape(match["latex"]).strip(), display="block" if block else "inline")
    return f'<div class="equation">{mathml}</div>' if block else mathml
