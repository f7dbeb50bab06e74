"""Programs of a checkout: set-up, tests and release; checks, benchmarks, figures and pages.  No part of the wheel."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]  # folder of the checkout
