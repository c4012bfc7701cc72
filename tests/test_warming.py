"""The kernel is compiled once for all that share a cache, by a process of its own, and whoever waits stays free for others."""

import threading
from pathlib import Path

import pytest

from dimersweep.errors import KernelError
from dimersweep.work import warming

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.fixture
def cold(monkeypatch, tmp_path):
    """Have nothing compiled, and another program in place of the compiler; what is done in this process is counted."""
    proven = []
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(warming, "is_proven", lambda: bool(proven))
    monkeypatch.setattr(warming, "prove", lambda: proven.append(warming.cache.under_way.is_set()))
    monkeypatch.setattr(warming, "COMPILE", "import time; open('made', 'a').write('x'); time.sleep(0.5)")
    return proven


def test_one_process_compiles_for_all(cold, monkeypatch):
    seen, threads = [], [threading.Thread(target=warming.get_ready) for _ in range(3)]
    monkeypatch.setattr(warming, "is_proven", lambda: False)
    for each in threads:
        each.start()
    while any(each.is_alive() for each in threads):
        seen.append(warming.cache.under_way.is_set())
        threads[0].join(0.02)
    for each in threads:
        each.join()
    assert Path("made").read_text() == "x"
    assert any(seen) and cold == [False] * 3
    warming.get_ready()
    assert Path("made").read_text() == "x", "it is there"


def test_it_is_loaded_where_it_was_compiled_before(cold):
    warming.get_ready()
    Path("made").unlink()
    cold.clear()
    warming.get_ready()
    assert not Path("made").exists() and cold


def test_a_compiler_that_is_killed_is_told_with_the_memory_that_it_takes(cold, monkeypatch):
    monkeypatch.setattr(warming, "COMPILE", "import os; os.kill(os.getpid(), 9)")
    with pytest.raises(
        KernelError, match=r"^kernel: the process that compiles it was ended by signal 9; a worker takes 270 "
    ):
        warming.get_ready()
    assert not cold and not warming.cache.under_way.is_set()


def test_a_compiler_that_fails_leaves_it_to_this_process(cold, monkeypatch, capsys):
    monkeypatch.setattr(warming, "COMPILE", "raise OSError('no room')")
    warming.get_ready()
    assert cold == [False]
    assert "kernel: compiled in this process, after OSError: no room\n" in capsys.readouterr().err


def test_where_no_code_can_be_kept_this_process_compiles(cold, monkeypatch):
    monkeypatch.setattr(warming.cache, "base_folders", lambda: [Path("/proc/nowhere/dimersweep")])
    warming.get_ready()
    assert not Path("made").exists() and cold == [False]


def test_where_a_lock_cannot_be_taken_another_folder_is_tried(cold, monkeypatch, tmp_path):
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        (folder / "compiling.lock").mkdir(parents=True)
    monkeypatch.setattr(warming.cache, "base_folders", lambda: folders)
    warming.get_ready()
    assert not Path("made").exists() and cold == [False]
    (folders[1] / "compiling.lock").rmdir()
    cold.clear()
    warming.get_ready()
    assert Path("made").exists() and cold == [False]


def test_the_command_says_that_it_is_ready(done):
    assert done("warm").startswith("kernel ")
