"""Compiled code is kept by the hash of all sources, so that no edit is missed, and in folders of our own alone."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import dimersweep
from dimersweep.kernel import cache
from dimersweep.kernel.jit import exported

PACKAGE = Path(dimersweep.__file__).parent
KERNEL = PACKAGE / "kernel"
fresh_version = cache.kernel_version.__wrapped__


def test_an_edit_in_any_kernel_module_changes_the_version(tmp_path):
    sources = tmp_path / "kernel"
    shutil.copytree(KERNEL, sources)
    (sources / "room" / "inner").mkdir(parents=True)
    (sources / "room" / "inner" / "module.py").touch()
    before = fresh_version(sources)
    for path in sources.rglob("*.py"):
        original = path.read_text()
        path.write_text(original + "\n")
        assert fresh_version(sources) != before, path.name
        path.write_text(original)
    assert fresh_version(sources) == before


def test_a_module_in_another_room_changes_the_version(tmp_path):
    for room in ("a", "b"):
        (tmp_path / "one" / room).mkdir(parents=True)
    (tmp_path / "one" / "a" / "module.py").touch()
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    assert cache.sources_digest(tmp_path / "one") == cache.sources_digest(tmp_path / "two")
    (tmp_path / "two" / "a" / "module.py").rename(tmp_path / "two" / "b" / "module.py")
    assert cache.sources_digest(tmp_path / "one") != cache.sources_digest(tmp_path / "two")


def run_python(code, tree=PACKAGE.parent, **environment):
    """What a fresh process with the package in `tree` prints; a variable that is None is taken out of its environment."""
    whole = os.environ | {"PYTHONPATH": str(tree)} | environment
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={name: value for name, value in whole.items() if value is not None},
        cwd=tree,
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SMALL = {  # a small program in a room of the kernel's
    "__init__": "",
    "below": f"from {exported.__module__} import compiled\n\n@compiled\ndef number():\n    return 1\n",
    "above": f"from {exported.__module__} import exported\nfrom dimersweep.kernel.room.below import number\n\n"
    "@exported\ndef twice():\n    return 2 * number()\n",
}


@pytest.fixture
def copy(tmp_path):
    """Folder of a copy of the package, with a small program in the kernel."""
    shutil.copytree(PACKAGE, tmp_path / "copy" / "dimersweep", ignore=shutil.ignore_patterns("__pycache__"))
    room = tmp_path / "copy" / "dimersweep" / "kernel" / "room"
    room.mkdir()
    for name, text in SMALL.items():
        (room / f"{name}.py").write_text(text)
    return tmp_path / "copy"


def twice(copy, first="pass", **environment):
    """Value of the small program, and the folder of its code, in a process of its own."""
    program = (
        f"{first}; from dimersweep.kernel.room.above import twice; from {cache.__name__} import code_folder; "
        "print(twice(), code_folder())"
    )
    value, place = run_python(program, copy, **environment).split()
    return int(value), Path(place)


@pytest.mark.jit
@pytest.mark.parametrize("first", ["import numba", "pass"], ids=["numba imported before", "numba imported after"])
def test_an_edit_in_an_imported_module_is_seen(tmp_path, copy, first):
    places = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": None}
    value, folder = twice(copy, first, **places)
    assert value == 2
    assert folder.parent == tmp_path / "cache" / "dimersweep"
    (code,) = folder.glob("twice-*")
    made = code.stat().st_mtime_ns
    assert twice(copy, first, **places) == (2, folder)
    assert code.stat().st_mtime_ns == made, "compiled again"
    below = copy / "dimersweep" / "kernel" / "room" / "below.py"
    below.write_text(below.read_text().replace("return 1", "return 21"))
    value, other = twice(copy, first, **places)
    assert value == 42
    assert other != folder
    assert not list(copy.rglob("*.nb?"))


def plant(folder, name):
    """A folder of a user's below `folder`, with a file in it, not touched for 60 days."""
    (folder / name).mkdir(parents=True)
    (folder / name / "notes.txt").write_text("mine")
    then = time.time() - 60 * 86400
    for path in (folder / name / "notes.txt", folder / name):
        os.utime(path, (then, then))


@pytest.mark.jit
@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("NUMBA_CACHE_DIR", "p/dimersweep/.numba"),
        ("NUMBA_CACHE_DIR", "p/dimersweep/0123456789abcdef"),
        ("NUMBA_CACHE_DIR", "p"),
        ("NUMBA_CACHE_DIR", "p/dimersweep"),
        ("XDG_CACHE_HOME", "p"),
        ("HOME", "p"),
    ],
)
def test_old_folders_of_a_user_stay(tmp_path, copy, variable, value):
    names = ("results", ".git", "0123456789abcde0")
    places = [
        tmp_path / start / end
        for start in ("p", "p/dimersweep", "p/.cache", "p/.cache/dimersweep", "p/dimersweep/.numba/dimersweep")
        for end in ("", "dimersweep")
    ]
    for folder in set(places):
        for name in names:
            plant(folder, name)
    environment = {"NUMBA_CACHE_DIR": None, "XDG_CACHE_HOME": None, variable: str(tmp_path / value)}
    assert twice(copy, **environment)[0] == 2
    missing = [folder / name for folder in places for name in names if not (folder / name / "notes.txt").exists()]
    assert missing == []


def test_folders_of_ours_that_are_unused_for_a_month_go(tmp_path):
    old = time.time() - 40 * 86400

    def ours(name, used, *files):
        (tmp_path / name).mkdir()
        for file in (cache.MARK, "run_rows-0.code", *files):
            (tmp_path / name / file).touch()
        os.utime(tmp_path / name / cache.MARK, (used, used))

    ours("0000000000000000", old)
    ours("1111111111111111", time.time() - 3 * 86400)
    ours("2222222222222222", old, "run_rows-0.1234.tmp")
    ours("3333333333333333", old, "notes.txt")  # a user's file in it
    ours("results", old)  # a name that none of ours has
    ours("ffffffffffffffff", old)
    (tmp_path / "4444444444444444").mkdir()  # no mark
    os.utime(tmp_path / "4444444444444444", (old, old))
    (tmp_path / "5555555555555555").symlink_to(tmp_path / "results")
    cache.prune(tmp_path, keep="0000000000000000")
    assert sorted(path.name[0] for path in tmp_path.iterdir()) == list("01345r")
    assert (tmp_path / "3333333333333333" / "run_rows-0.code").exists()
    assert (tmp_path / "results" / "run_rows-0.code").exists()


@pytest.mark.jit
def test_settings_of_the_process_stay_as_they_are():
    program = (
        "import os\n"
        "before = dict(os.environ)\n"
        "import dimersweep, dimersweep.kernel\n"
        "assert os.environ == before\n"
        "import numba\n"
        "def settings(): return {name: value for name, value in vars(numba.config).items() if name.isupper()}\n"
        "found = settings()\n"
        "dimersweep.simulate(periods=1, record=False)\n"
        "assert settings() == found and os.environ == before\n"
        "print(found['CACHE_DIR'] == '')"
    )
    assert run_python(program, NUMBA_CACHE_DIR=None) == "True\n"


def test_a_chosen_folder_is_the_base_and_a_child_process_shares_it(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = cache.code_folder()
    assert folder == tmp_path / "dimersweep" / cache.kernel_version()
    assert run_python(f"from {cache.__name__} import code_folder; print(code_folder())") == f"{folder}\n"
    assert not cache.is_compiled()
