"""Package of the page that cuts, for a learning platform: SCORM 1.2."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

from cutenv._base.document import render
from cutenv._base.language_files import ENGLISH, texts_by_key
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range
from cutenv.browser.page_alone import page_alone

_HERE = Path(__file__).parent / "page"
_PAGE = "cut.html"
_DATE = (2000, 1, 1, 0, 0, 0)  # of every file, so that the same page gives the same package


def write_scorm_package(path: Path, *, pass_mark: float | None = None, **options: Any) -> int:
    """Write a SCORM 1.2 package of the page, as a whole or not at all; return its size [bytes].

    Parameters
    ----------
    path : Path
        Package to write (.zip).
    pass_mark : float, optional
        Overall score with which the page reports "passed", 0 to 100; without one it reports "completed".
    **options
        Those of :func:`~cutenv.browser.page_alone.page_alone`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    OSError
        If the package cannot be written.
    """
    if pass_mark is not None:
        in_range("pass_mark", pass_mark, 0.0, 100.0, "1", "The overall score is from 0 to 100.")
    page = page_alone(**options, platform={"mark": None if pass_mark is None else round(pass_mark, 1)})
    texts = texts_by_key(options.get("language", ENGLISH))
    identifier = hashlib.sha256(page.encode()).hexdigest()[:16]
    manifest = render(_HERE / "imsmanifest.xml", {"identifier": identifier, "page": _PAGE, "title": texts["title"]})
    with atomic_write(path) as part, zipfile.ZipFile(part, "w") as package:
        for name, content in (("imsmanifest.xml", manifest), (_PAGE, page)):
            package.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return path.stat().st_size
