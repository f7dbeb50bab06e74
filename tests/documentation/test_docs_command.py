"""``cutenv docs`` opens the pages that come with a wheel, and says how to build them where there are none."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from cutenv._base import resources
from cutenv.commands import docs
from cutenv.commands.cli import main

ROOT = Path(__file__).parents[2]
IGNORED = shutil.ignore_patterns("__pycache__", "site")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Copy what a distribution is made of, without built pages."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    for name in ("cutenv", "assets"):
        shutil.copytree(ROOT / name, folder / name, ignore=IGNORED)
    (folder / "scripts" / "kernels").mkdir(parents=True)
    hook = "scripts/kernels/wheel_hook.py"
    for name in ("pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", ".gitignore", hook):
        shutil.copy(ROOT / name, folder / name)
    return folder


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run([sys.executable, *map(str, command)], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_wheel_holds_the_built_pages_and_finds_them(checkout: Path, tmp_path: Path) -> None:
    """One of the checkout; one that an sdist makes is the same (tests/packaging/test_distribution.py)."""
    (checkout / "assets" / "site").mkdir()
    (checkout / "assets" / "site" / "index.html").write_text("<h1>cutenv</h1>")
    run("-m", "build", "--no-isolation", "--wheel", "--outdir", tmp_path / "dist", checkout, cwd=tmp_path)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    code = (
        "import sys; sys.path.insert(0, 'installed')\n"
        "from cutenv.commands.cli import main; main(['docs', '--print-path'])"
    )
    printed = Path(run("-c", code, cwd=tmp_path).strip())
    assert printed == tmp_path / "installed" / "cutenv" / "assets" / "site" / "index.html"
    assert printed.read_text() == "<h1>cutenv</h1>"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Pretend that the package was installed from a checkout without built pages; its folder."""
    source = tmp_path / "a checkout"
    (source / "assets").mkdir(parents=True)
    (source / "mkdocs.yml").touch()
    told = SimpleNamespace(read_text=lambda name: json.dumps({"url": source.as_uri()}))
    monkeypatch.setattr(docs, "distribution", lambda name: told)
    monkeypatch.setattr(resources, "__file__", str(tmp_path / "site-packages" / "cutenv" / "_base" / "resources.py"))
    monkeypatch.setattr(resources, "_CHECKOUT", tmp_path / "nowhere")
    return source


def test_without_pages_it_says_what_builds_them(
    installed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(docs, "find_spec", lambda name: None)
    assert main(["docs"]) == 1
    (installed / "mkdocs.yml").unlink()
    assert main(["docs"]) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert f"pip install '{installed}[docs]'" in first
    assert "built without its pages" in second


def test_it_builds_the_pages_of_the_checkout_that_it_was_installed_from(
    installed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = installed / "assets" / "site" / "index.html"

    def build(command: list[str], *, cwd: Path, **_: object) -> SimpleNamespace:
        assert command[1:4] == ["-m", "mkdocs", "build"]
        (cwd / "assets" / "site").mkdir()
        (cwd / "assets" / "site" / "index.html").touch()
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(docs.subprocess, "run", build)
    assert main(["docs", "--print-path"]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    monkeypatch.delattr(docs.subprocess, "run")
    assert main(["docs", "--print-path"]) == 0  # they are there now


@pytest.mark.parametrize("browser", [True, False])
def test_the_browser_gets_the_first_page_and_without_one_its_path_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], browser: bool
) -> None:
    page = tmp_path / "site" / "index.html"
    page.parent.mkdir()
    page.touch()
    opened: list[str] = []
    monkeypatch.setattr(resources, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(docs.webbrowser, "open", lambda address: opened.append(address) is None and browser)
    assert main(["docs"]) == 0
    assert opened == [page.as_uri()]
    assert capsys.readouterr().out.strip() == ("" if browser else str(page))
