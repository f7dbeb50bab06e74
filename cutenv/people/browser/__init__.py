"""Cuts by a person in a web browser.

The compiled task as WebAssembly, in a page that fetches nothing.

``scripts/build_browser_law.py`` makes the programs in ``assets/browser``, one for each task, from the kernels that
Python runs, so a cut in the browser is that of Python to the last bit.  They are kept with the data because their
linker is large.
"""

from __future__ import annotations

from cutenv.people.browser.page_alone import write_page_alone, write_scorm_package
from cutenv.people.browser.stylus_steps import HandCut

__all__ = ["HandCut", "write_page_alone", "write_scorm_package"]
