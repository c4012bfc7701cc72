"""Build the source distribution and, from it, the wheel; try the wheel in an environment of its own."""

import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

import dimersweep

ROOT = Path(__file__).parents[1]

pytestmark = [
    pytest.mark.jit,
    pytest.mark.release,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout"),
]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    subprocess.run([sys.executable, "-m", "build", "--outdir", folder, ROOT], check=True, capture_output=True)
    return folder


def test_the_source_distribution_has_what_is_tracked_and_nothing_else(built):
    name = f"dimersweep-{dimersweep.__version__}"
    with tarfile.open(built / f"{name}.tar.gz") as archive:
        packed = {each.name.removeprefix(f"{name}/") for each in archive.getmembers() if not each.isdir()}
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    # a tracked link to a folder is packed as that folder
    files = {each for each in tracked if not (ROOT / each).is_dir()}
    assert not files - packed
    assert {each for each in packed - files if not each.startswith(("docs/notebooks/", "notebooks/"))} == {"PKG-INFO"}


def test_the_wheel_makes_a_sweep_and_its_figure_where_nothing_else_is_installed(built, tmp_path):
    (wheel,) = built.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "env"], check=True)
    programs = tmp_path / "env" / "bin"
    subprocess.run([programs / "python", "-m", "pip", "install", "--quiet", wheel], check=True)
    subprocess.run([programs / "python", "-m", "pip", "check"], check=True)

    def said(*command):
        done = subprocess.run(
            [programs / "dimersweep", *command], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return done.stdout + done.stderr

    assert said("--version") == f"dimersweep {dimersweep.__version__}\n"
    assert "fig07-small" in said("presets")
    said("run", "fig07-small")
    assert (tmp_path / "fig07-small.nc").exists()
    assert (tmp_path / "fig07-small.png").exists()
    said("orbits", "--Gamma", "0.9", "--spin", "100")
    typed = programs.parent.glob("lib/python*/site-packages/dimersweep/py.typed")
    assert list(typed)
