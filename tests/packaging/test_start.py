"""``scripts/start.py`` sets up once, and refuses with the cure where it cannot."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest

from scripts import start

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts" / "start.py"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Lay out the files that set-up reads, without a virtual environment."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(SCRIPT, tmp_path / "scripts")
    for name in ("pyproject.toml", "constraints.txt", "constraints-distributed.txt"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def venv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a virtual environment whose pip is a stand-in: it only has to be imported here."""
    folder = tmp_path_factory.mktemp("project") / ".venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    answer = subprocess.run([start.python_of(folder), "-c", code], capture_output=True, text=True, check=True)
    (Path(answer.stdout.strip()) / "pip.py").touch()
    return folder


def stamp(venv: Path, text: str) -> None:
    (venv / "cutenv-setup.txt").write_text(text)


def plan(**urls: str) -> dict[str, list[object]]:
    """Write what pip's dry run reports, as far as it is read: names and addresses."""
    names = {name.replace("_", "-"): url for name, url in urls.items()}
    return {"install": [{"metadata": {"name": n}, "download_info": {"url": u}} for n, u in names.items()]}


# Pythons


def test_this_python_is_among_those_that_the_classifiers_name() -> None:
    supported = start.supported_pythons((ROOT / "pyproject.toml").read_text())
    assert supported[0] == "3.11"
    start.check_python(start.PYTHON, sys.implementation.name, supported)


@pytest.mark.parametrize(("version", "implementation"), [("3.10", "cpython"), ("3.99", "cpython"), ("3.11", "pypy")])
def test_a_python_without_wheels_is_refused_and_those_that_work_are_named(version: str, implementation: str) -> None:
    with pytest.raises(start.Refusal, match=rf"{implementation} {version}.*CPython 3\.11, 3\.12"):
        start.check_python(version, implementation, ["3.11", "3.12"])


# What set-up needs


@pytest.mark.parametrize("module", ["venv", "ensurepip"])
def test_a_missing_venv_module_is_refused_with_the_cure(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    start.check_venv_module()
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(start.Refusal, match=r"Cure: .*apt install python3\.\d+-venv"):
        start.check_venv_module()


def test_a_full_disk_is_refused_with_the_need_and_what_is_free() -> None:
    start.check_disk(start.DISK_BYTES, start.DISK_BYTES)
    with pytest.raises(start.Refusal, match=r"needs 3\.0 GB.*; 2\.5 GB are free(?s:.*)Cure: free some space"):
        start.check_disk(2_500_000_000, start.DISK_BYTES)


def test_a_folder_that_cannot_be_written_to_is_refused_with_the_cure(tmp_path: Path) -> None:
    start.check_writable(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(start.Refusal, match=r"cannot be written to(?s:.*)Cure: copy the project"):
        start.check_writable(tmp_path / "file")


# What pip complains of

CONNECTION = "connection broken by 'NewConnectionError(...: Failed to establish a new connection: [Errno 111]"
NO_PIP = "ERROR: Could not find a version that satisfies the requirement pip==26.3 (from versions: none)"
CONSTRAINED_PIP = "ERROR: Cannot install pip because these package versions have conflicting dependencies."
NO_WHEEL = "ERROR: No matching distribution found for torch>=2.8"
CONFLICT = "ERROR: ResolutionImpossible: the dependency resolver has no answer"
FULL = "ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device"


@pytest.mark.parametrize(
    ("errors", "cure"),
    [
        (f"WARNING: Retrying after {CONNECTION}\n{NO_PIP}", "index cannot be reached. Cure: connect"),
        (NO_PIP, "index cannot be reached. Cure: connect"),
        (CONSTRAINED_PIP, "index cannot be reached. Cure: connect"),
        (NO_WHEEL, "no wheel of torch>=2.8 for Python 3"),
        (FULL, "disk is full. Cure: free some space"),
        (CONFLICT, "its own messages are above"),
    ],
    ids=["no connection", "no index", "no index for an update", "no wheel", "full disk", "something else"],
)
def test_what_pip_complains_of_becomes_a_cure(errors: str, cure: str) -> None:
    assert cure in start.cure_for(errors)


def test_without_a_network_set_up_fails_and_names_the_cure(project: Path) -> None:
    closed = {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_RETRIES": "0", "PIP_CONFIG_FILE": os.devnull}
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    command = [sys.executable, "scripts/start.py", "test"]
    ran = subprocess.run(command, cwd=project, env=environment | closed, capture_output=True, text=True)
    assert ran.returncode == 1
    assert "Cure: connect to the network and run this again" in ran.stderr
    assert "Traceback" not in ran.stderr


# CUDA

CPU_PLAN = plan(numpy="n.whl", torch="torch-2.13.0+cpu.whl", nvidiaesque="x.whl")


@pytest.fixture
def no_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start.shutil, "which", lambda name: None)
    monkeypatch.setattr(start.Path, "exists", lambda path: False)
    monkeypatch.setattr(start.sys, "platform", "linux")


@pytest.fixture
def cuda_plan(tmp_path: Path) -> dict[str, list[object]]:
    """Plan torch with two CUDA packages of 1.5 GB in all, in sparse files that stand in for an index."""
    urls = {}
    for name, size in {"numpy": 7, "torch": 5 * 10**8, "nvidia_cudnn_cu13": 9 * 10**8, "triton": 10**8}.items():
        path = tmp_path / f"{name}.whl"
        with path.open("wb") as file:
            file.truncate(size)
        urls[name] = path.as_uri()
    return plan(**urls)


def test_a_cpu_plan_has_no_cuda_wheels() -> None:
    assert start.cuda_wheels(CPU_PLAN) == []


@pytest.mark.usefixtures("no_driver")
def test_cuda_without_a_driver_is_refused_with_its_size_and_the_cure(cuda_plan: dict[str, list[object]]) -> None:
    start.check_cuda(CPU_PLAN, accepted=False)
    with pytest.raises(start.Refusal, match=r"\(1\.5 GB\)(?s:.*)Cure: add '--torch-index URL'"):
        start.check_cuda(cuda_plan, accepted=False)


@pytest.mark.usefixtures("no_driver")
def test_an_index_that_tells_no_sizes_is_not_guessed_at() -> None:
    cuda = plan(torch="file:///nowhere/torch.whl", nvidia_nccl_cu13="file:///nowhere/nccl.whl")
    with pytest.raises(start.Refusal, match="the index does not give the size"):
        start.check_cuda(cuda, accepted=False)


@pytest.mark.usefixtures("no_driver")
def test_accepted_cuda_must_fit_on_the_disk(
    cuda_plan: dict[str, list[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    start.check_cuda(cuda_plan, accepted=True)
    monkeypatch.setattr(start.shutil, "disk_usage", lambda root: types.SimpleNamespace(free=start.DISK_BYTES))
    with pytest.raises(start.Refusal, match=r"needs 7\.5 GB"):
        start.check_cuda(cuda_plan, accepted=True)


def test_cuda_with_a_driver_is_what_was_wanted(
    cuda_plan: dict[str, list[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start.shutil, "which", lambda name: f"/usr/bin/{name}")
    start.check_cuda(cuda_plan, accepted=False)


# Once is enough


def test_help_is_given_before_anything_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(start, "ROOT", tmp_path)
    monkeypatch.setattr(start, "set_up", lambda *arguments: pytest.fail("it began to install"))
    assert start.main(["train", "--help"]) == 0
    assert "after 'setup'" in capsys.readouterr().out
    (tmp_path / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text())
    (tmp_path / "constraints.txt").touch()
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / "cutenv-setup.txt").write_text(f"{'0' * 64} dev")  # of an earlier checkout
    assert start.main(["test", "--help"]) == 0
    assert "after 'setup'" in capsys.readouterr().out
    with pytest.raises(pytest.fail.Exception, match="began to install"):
        start.main(["train", "--quick"])


def test_a_finished_set_up_is_ready_and_is_left_alone(venv: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = start.fingerprint(ROOT, sys.version)
    stamp(venv, f"{wanted} dev")
    assert start.state_of(venv, wanted, "dev") == "ready"
    monkeypatch.setattr(start, "pip", lambda *arguments: pytest.fail("pip was called"))
    for extra in ("dev", "rl"):
        start.set_up(venv, extra, torch_index=None, accept_cuda=False)


def test_other_requirements_are_installed_over_it(venv: Path) -> None:
    stamp(venv, "an-older-one dev")
    assert start.state_of(venv, "a-newer-one", "dev") == "stale"


def test_training_installs_what_it_needs_and_the_tests_the_rest(venv: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []

    def pip(venv: Path, *arguments: str) -> None:
        asked.append(arguments)
        if "--report" in arguments:
            (venv / "cutenv-plan.json").write_text('{"install": []}')

    monkeypatch.setattr(start, "pip", pip)
    stamp(venv, "an-older-one dev")
    wanted = start.fingerprint(ROOT, sys.version)
    for command, extra in (("train", "rl"), ("test", "dev")):
        start.set_up(venv, start.EXTRAS[command], torch_index=None, accept_cuda=False)
        assert asked[-1][-2:] == ("-e", f".[{extra}]")
        assert start.state_of(venv, wanted, extra) == "ready"
        assert start.state_of(venv, wanted, "dev") == ("ready" if extra == "dev" else "stale")
    count = len(asked)
    start.set_up(venv, start.EXTRAS["train"], torch_index=None, accept_cuda=False)
    assert len(asked) == count


def test_every_command_names_an_extra_that_there_is() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(start.EXTRAS) == set(start.PROGRAMS)
    assert {*start.EXTRAS.values(), start.RAY} <= set(extras)
    names = {re.split(r"[<>=\[]", entry)[0] for entry in extras["rl"]}
    assert {"torch", "stable-baselines3", "matplotlib", "safetensors", "tqdm"} <= names
    assert "pytest" not in names


def test_an_interrupted_set_up_is_made_anew(venv: Path) -> None:
    stamp(venv, start.INTERRUPTED)
    assert start.state_of(venv, start.INTERRUPTED, "dev") == "broken"


def test_another_python_is_made_anew(venv: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stamp(venv, "wanted dev")
    monkeypatch.setattr(start.sys, "version", "3.12.0 (another one)")
    assert start.state_of(venv, "wanted", "dev") == "broken"


def test_no_or_half_a_virtual_environment_is_made_anew(tmp_path: Path) -> None:
    assert start.state_of(tmp_path / ".venv", "wanted", "rl") == "broken"
    half = tmp_path / "half"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", half], check=True)
    stamp(half, "wanted rl")
    assert start.state_of(half, "wanted", "rl") == "broken"


def test_the_fingerprint_follows_requirements_folder_and_python(project: Path, tmp_path: Path) -> None:
    before = start.fingerprint(project, "3.11")
    assert start.fingerprint(project, "3.11") == before
    assert start.fingerprint(project, "3.12") != before
    moved = shutil.copytree(project, tmp_path / "moved")
    assert start.fingerprint(moved, "3.11") != before
    with (project / "constraints.txt").open("a") as file:
        file.write("another==1\n")
    assert start.fingerprint(project, "3.11") != before


# The command line


def test_help_needs_no_set_up_and_lists_the_commands(project: Path) -> None:
    ran = subprocess.run([sys.executable, "scripts/start.py", "--help"], cwd=project, capture_output=True, text=True)
    assert ran.returncode == 0
    assert all(command in ran.stdout for command in start.PROGRAMS)
    assert not (project / ".venv").exists()


def test_arguments_are_passed_on_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    became: list[list[str]] = []
    made: list[tuple[str, str]] = []
    monkeypatch.setattr(start, "set_up", lambda venv, extra, *rest: made.append((venv.name, extra)))
    monkeypatch.setattr(start.os, "execv", lambda program, command: became.append(command))
    monkeypatch.chdir(ROOT)
    start.main(["train", "--quick", "--torch-index", "elsewhere", "--seed", "3"])
    assert made == [(".venv", "rl")]
    start.main(["test", "-k", "packaging", "tests/packaging"])
    assert made[1:] == [(".venv", "dev"), (".venv-ray", "distributed")]
    start.main(["test", "--long", "--list"])
    assert became[0][1:] == ["-m", "cutenv", "train", "--quick", "--seed", "3"]
    assert became[1][1:] == ["-m", "pytest", "-n", "2", "--dist", "worksteal", "-k", "packaging", "tests/packaging"]
    assert became[2][1:] == ["-m", "scripts.long_checks", "--list"]
    start.main(["train"])
    assert became.pop()[3:] == ["train", "--timesteps", "3500000", "--task", "gentle", "excision"]
    start.main(["test", "--fast", "--since", "HEAD~1"])
    assert became[3][1:] == ["-m", "scripts.fast_tests", "--since", "HEAD~1"]


@pytest.mark.parametrize("line", [["train", "--long"], ["train", "--fast"], ["test", "--fast", "--long"]])
def test_fast_or_long_is_for_the_tests(line: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        start.main(line)
    assert "--fast or --long is for the command 'test'" in capsys.readouterr().err


def test_rays_environment_is_asked_for_with_its_own_constraints(venv: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []

    def pip(venv: Path, *arguments: str) -> None:
        asked.append(arguments)
        (venv / "cutenv-plan.json").write_text('{"install": []}')

    monkeypatch.setattr(start, "pip", pip)
    stamp(venv, "an-older-one distributed")
    start.set_up(venv, start.RAY, torch_index=None, accept_cuda=False)
    assert asked[-1] == (
        *("install", "-c", "constraints-distributed.txt", "--only-binary", ":all:"),
        *("pytest", "-e", ".[distributed]"),
    )


def test_rays_constraints_are_those_of_the_others_but_for_gymnasium() -> None:
    tested, rays = (
        dict(re.findall(r"^([\w-]+)==(\S+)$", (ROOT / name).read_text(), flags=re.MULTILINE))
        for name in ("constraints.txt", "constraints-distributed.txt")
    )
    assert {name for name in tested.keys() & rays.keys() if tested[name] != rays[name]} == {"gymnasium"}
    assert rays.keys() - tested.keys() == {"ray"}


def test_an_interrupted_set_up_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(start, "set_up", interrupt)
    assert start.main(["setup"]) == 130
    assert "the same command starts again" in capsys.readouterr().err


def test_no_host_is_written_in_the_script() -> None:
    assert "://" not in SCRIPT.read_text()
