"""Compiled code is kept by the hash of all kernel sources, so that an edit in any of them is never missed."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dimersweep.kernel import cache

KERNEL = Path(cache.__file__).parent
fresh_version = cache.kernel_version.__wrapped__


def test_an_edit_in_any_kernel_module_changes_the_version(tmp_path):
    sources = tmp_path / "kernel"
    shutil.copytree(KERNEL, sources)
    before = fresh_version(sources)
    assert before == cache.kernel_version()
    for path in sources.glob("*.py"):
        original = path.read_text()
        path.write_text(original + "\n")
        assert fresh_version(sources) != before, path.name
        path.write_text(original)
    assert fresh_version(sources) == before


MODULES = {
    "__init__": "from mini.cache import use_cache_folder\nfolder = use_cache_folder()\n",
    "below": "import numba\n\n@numba.njit(cache=True)\ndef number():\n    return 1\n",
    "above": "import numba\nfrom mini.below import number\n\n"
    "@numba.njit(cache=True)\ndef twice():\n    return 2 * number()\n",
}


def run_mini(folder, first):
    """Value and cache folder of a small package that is compiled in a process of its own."""
    code = f"{first}; import mini; from mini.above import twice; print(twice(), mini.folder)"
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=120
    )
    value, place = done.stdout.split()
    return int(value), Path(place)


@pytest.mark.jit
@pytest.mark.parametrize("first", ["import numba", "pass"], ids=["numba imported before", "numba imported after"])
def test_an_edit_in_an_imported_module_is_seen(tmp_path, first):
    package = tmp_path / "mini"
    package.mkdir()
    shutil.copy(KERNEL / "cache.py", package)
    for name, text in MODULES.items():
        (package / f"{name}.py").write_text(text)
    value, folder = run_mini(tmp_path, first)
    assert value == 2
    assert folder.parent == tmp_path / "cache" / "dimersweep"
    assert list(folder.rglob("*.nbi")), "Numba did not use the folder"
    (package / "below.py").write_text(MODULES["below"].replace("return 1", "return 21"))
    new_value, new_folder = run_mini(tmp_path, first)
    assert new_value == 42
    assert new_folder != folder


def test_a_chosen_folder_is_the_base_and_a_child_process_shares_it(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))  # to be put back
    folder = cache.use_cache_folder()
    assert folder == tmp_path / "dimersweep" / cache.kernel_version()
    assert os.environ["NUMBA_CACHE_DIR"] == str(folder)
    assert cache.use_cache_folder() == folder
    assert not cache.is_compiled()


def test_folders_unused_for_a_month_go(tmp_path):
    for name, days in (("current", 40), ("recent", 3), ("old", 40)):
        (tmp_path / name).mkdir()
        used = time.time() - days * 86400
        os.utime(tmp_path / name, (used, used))
    cache.prune(tmp_path, keep="current")
    assert sorted(os.listdir(tmp_path)) == ["current", "recent"]
