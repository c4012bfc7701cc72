"""Compiled code is kept by the hash of all sources, so that no edit is missed, and in folders of our own alone."""

import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import dimersweep
from dimersweep import cli, parameters, plots
from dimersweep.kernel import batch
from dimersweep.kernel.compiler import cache, pipelines, versions
from dimersweep.kernel.compiler.jit import exported
from dimersweep.studies import deciding
from dimersweep.work import progress, tiles

PACKAGE = Path(dimersweep.__file__).parent
KERNEL = PACKAGE / "kernel"
VERSION = "0123456789abcdef"


def digest_below(folder):
    return versions.digest_of(versions.sources(folder))


def test_an_edit_in_any_module_changes_the_hash(tmp_path):
    sources = tmp_path / "kernel"
    shutil.copytree(KERNEL, sources)
    (sources / "room" / "inner").mkdir(parents=True)
    (sources / "room" / "inner" / "module.py").touch()
    before = digest_below(sources)
    for path in sources.rglob("*.py"):
        original = path.read_text()
        path.write_text(original + "\n")
        assert digest_below(sources) != before, path.name
        path.write_text(original)
    assert digest_below(sources) == before


def test_a_module_in_another_room_changes_the_version(tmp_path):
    for room in ("a", "b"):
        (tmp_path / "one" / room).mkdir(parents=True)
    (tmp_path / "one" / "a" / "module.py").touch()
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    assert digest_below(tmp_path / "one") == digest_below(tmp_path / "two")
    (tmp_path / "two" / "a" / "module.py").rename(tmp_path / "two" / "b" / "module.py")
    assert digest_below(tmp_path / "one") != digest_below(tmp_path / "two")


def run_python(code, *arguments, tree=PACKAGE.parent, **environment):
    """What a fresh process with the package in `tree` prints; a variable that is None is taken out of its environment."""
    whole = os.environ | {"PYTHONPATH": str(tree)} | environment
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={name: value for name, value in whole.items() if value is not None},
        cwd=tree,
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


CACHED = (versions.take_sources, versions.code_version, versions.kernel_version)


@pytest.fixture
def versions_of(monkeypatch):
    """Return a function that gives the versions of code and of results of a copy, as a new process reads them there."""

    def read(tree):
        monkeypatch.setattr(versions, "PACKAGE", tree / "dimersweep")
        for each in CACHED:
            each.cache_clear()
        return versions.code_version(pipelines.pipeline()), versions.kernel_version()

    yield read
    for each in CACHED:
        each.cache_clear()


@pytest.mark.parametrize(
    ("module", "code", "results"),
    [
        (batch, True, True),
        (parameters, False, True),
        (deciding, False, True),
        (tiles, False, False),
        (dimersweep, False, False),
        (plots, False, False),
        (cli, False, False),
    ],
    ids=lambda given: getattr(given, "__name__", ""),
)
def test_what_an_edit_changes(copy, module, code, results, versions_of):
    untouched = versions_of(copy)
    path = copy / "dimersweep" / Path(module.__file__).relative_to(PACKAGE)
    text = path.read_text()
    for edit, changed in (("# an edited comment", False), ("SIGN = -1", results)):
        path.write_text(f"{text}\n{edit}\n")
        assert [new != old for new, old in zip(versions_of(copy), untouched, strict=True)] == [code, changed]


SETTINGS = {  # of the compiler: what no program sets, and what a user may
    "usual": {},
    "elsewhere": {"NUMBA_CACHE_DIR": "elsewhere", "NUMBA_NUM_THREADS": "1"},
    "common": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""},
    "less": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "-fma"},
    **{name: {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""} for name in ("skylake-avx512", "haswell", "znver2")},
    "generic": {"NUMBA_CPU_NAME": "generic"},
    "uncompiled": {"NUMBA_DISABLE_JIT": "1"},
    "optimised less": {"NUMBA_OPT": "1"},
    "bounds": {"NUMBA_BOUNDSCHECK": "1"},
    "without AVX": {"NUMBA_ENABLE_AVX": "0"},
    "SLP": {"NUMBA_SLP_VECTORIZE": "1"},
}
TELL = f"""
import json, os, sys
from {pipelines.__name__} import first_pipeline, versions
import numba
whole = dict(os.environ)
for name, setting in json.loads(sys.argv[1]).items():
    os.environ.clear()
    os.environ.update(whole | setting)
    numba.config.reload_config()  # as a new process reads them
    versions.code_version.cache_clear()
    versions.kernel_version.cache_clear()
    print(json.dumps([name, versions.code_version(first_pipeline()), versions.kernel_version()]))
"""


@pytest.fixture(scope="module")
def told():
    """The versions of code and of results by the settings of the compiler, all in one process of its own."""
    lines = map(json.loads, run_python(TELL, json.dumps(SETTINGS)).splitlines())
    return {name: tuple(rest) for name, *rest in lines}


@pytest.mark.parametrize("name", [name for name in SETTINGS if name not in ("usual", "elsewhere", "common")])
def test_settings_and_processors_change_the_code_alone(told, name):
    """What a cube is made of does not depend on who has compiled: each process proves that."""
    (code, results), (usual, of_all) = told[name], told["usual"]
    assert results == of_all and code not in (usual, told["common"][0])


def test_places_and_threads_change_no_version(told):
    assert told["elsewhere"] == told["usual"]


def test_a_new_process_has_the_versions_of_this_one(told):
    assert told["usual"] == (versions.code_version(pipelines.pipeline()), versions.kernel_version())


def test_the_versions_tell_target_and_packages():
    told = versions.compiler(pipelines.FAST)
    assert {"numba", "llvmlite", "numpy", "python", "target"} <= set(told)
    assert "libc" not in told  # the kernel has elementary functions of its own
    assert told["numba"] == version("numba") and told["llvmlite"] == version("llvmlite")


SMALL = {  # a small program in a room of the kernel's
    "__init__": "",
    "below": f"from {exported.__module__} import compiled\n\n@compiled\ndef number():\n    return 1\n",
    "above": f"from {exported.__module__} import exported\nfrom dimersweep.kernel.room.below import number\n\n"
    "@exported\ndef twice():\n    return 2 * number()\n",
}


def copied_to(folder):
    """The folder with a copy of the package, with a small program in the kernel."""
    shutil.copytree(PACKAGE, folder / "dimersweep")
    room = folder / "dimersweep" / "kernel" / "room"
    room.mkdir()
    for name, text in SMALL.items():
        (room / f"{name}.py").write_text(text)
    return folder


@pytest.fixture
def copy(tmp_path):
    """Folder of a copy."""
    return copied_to(tmp_path / "copy")


def twice(copy, first="pass", **environment):
    """Value of the small program, and the file of its code, in a process of its own."""
    program = (
        f"{first}; from dimersweep.kernel.room.above import twice; from {pipelines.__name__} import cache, versions, pipeline; "
        "print(twice(), cache.files(versions.code_version(pipeline()))[0])"
    )
    value, place = run_python(program, tree=copy, **environment).split()
    return int(value), Path(place)


def test_who_changes_the_physics_is_warned_and_goes_on(copy):
    """Uncompiled, which is quicker here; that an edit is compiled anew is tried below."""
    body = copy / "dimersweep" / "kernel" / "model" / "body.py"
    text = body.read_text()
    assert text.count("J_t = 0.4 * (m_1 * (r_1 * r_1)") == 1
    body.write_text(text.replace("J_t = 0.4 * (m_1 * (r_1 * r_1)", "J_t = 0.6 * (m_1 * (r_1 * r_1)"))
    program = (
        "import warnings, dimersweep\n"
        "with warnings.catch_warnings(record=True) as said:\n"
        "    run = dimersweep.simulate(periods=1, record=False)\n"
        "lines = [str(each.message) for each in said]\n"
        "print(run.status, *(line for line in lines if line.startswith('kernel')))"
    )
    status, told = run_python(program, tree=copy, NUMBA_DISABLE_JIT="1", DIMERSWEEP_OTHER_PHYSICS="1").split(" ", 1)
    assert status == "ok"
    assert told.startswith("kernel: gives other digits for the base case (radius 4.286")
    assert told.endswith("; DIMERSWEEP_OTHER_PHYSICS is set\n")


@pytest.mark.jit
@pytest.mark.parametrize("first", [pytest.param("import numba", marks=pytest.mark.release), "pass"])
def test_an_edit_in_an_imported_module_is_seen(tmp_path, copy, first):
    places = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": None}
    value, code = twice(copy, first, **places)
    assert value == 2
    assert [code] == list((tmp_path / "cache" / "dimersweep").glob("*-twice-*"))
    made = code.stat().st_ino
    assert twice(copy, first, **places) == (2, code)
    assert code.stat().st_ino == made, "compiled again"
    below = copy / "dimersweep" / "kernel" / "room" / "below.py"
    below.write_text(below.read_text().replace("return 1", "return 21"))
    value, other = twice(copy, first, **places)
    assert value == 42
    assert other != code
    assert not list(copy.rglob("*.nb?"))


@pytest.mark.jit
def test_code_that_is_loaded_starts_no_compiler(tmp_path, copy):
    """Which would take as long as all else that a process does before its first run."""
    first = "import sys, dimersweep.kernel.room.above as above; print(above.twice(), 'numba.np.linalg' in sys.modules)"
    told = [run_python(first, tree=copy, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert told == ["2 True\n", "2 False\n"]


@pytest.mark.jit
def test_code_is_not_kept_under_the_name_of_sources_that_were_changed_meanwhile(tmp_path, copy):
    below = copy / "dimersweep" / "kernel" / "room" / "below.py"
    program = (
        "from pathlib import Path; from dimersweep.kernel.room.above import twice\n"
        f"below = Path({str(below)!r}); below.write_text(below.read_text().replace('return 1', 'return 21'))\n"
        "print(twice())"
    )
    assert run_python(program, tree=copy, NUMBA_CACHE_DIR=str(tmp_path)) == "2\n"
    assert twice(copy, NUMBA_CACHE_DIR=str(tmp_path))[0] == 42


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
        pytest.param("NUMBA_CACHE_DIR", "p/dimersweep/0123456789abcdef", marks=pytest.mark.release),
        pytest.param("XDG_CACHE_HOME", "p", marks=pytest.mark.release),
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


@pytest.fixture
def places(tmp_path, monkeypatch):
    """The place that a user has chosen, and a temporary folder; none can be written yet."""
    names = {"NUMBA_CACHE_DIR": tmp_path / "chosen", "TMPDIR": tmp_path / "tmp"}
    for name, path in names.items():
        path.touch()  # a file in the place of a folder
        monkeypatch.setenv(name, str(path))
    return names


def allow(path):
    path.unlink()
    path.mkdir()
    return path


def test_files_of_ours_that_are_unused_for_a_month_go(tmp_path):
    now, old = time.time(), time.time() - 40 * 86400
    stay = {
        f"{VERSION}-used-0.code": now - 3 * 86400,
        f"{VERSION}-used-0.notes.txt": old,
        "results.code": old,  # names that none of ours has
        "results-2024.code": old,
        "0123456789ABCDEF-twice-0.code": old,
        "notes.tmp": old,
        "compiling.lock": old,
    }
    go = {f"{VERSION}-twice-0.code": old, f"{VERSION}-twice-0.12ab.tmp": old, f"{'f' * 16}-warm.code": old}
    for name, used in (stay | go).items():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (used, used))
    plant(tmp_path, f"{VERSION}-folder.code")
    (tmp_path / f"{VERSION}-link.code").symlink_to(tmp_path / "results.code")
    os.utime(tmp_path / f"{VERSION}-link.code", (old, old), follow_symlinks=False)
    cache.prune(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*stay, f"{VERSION}-folder.code"}
    assert (tmp_path / f"{VERSION}-folder.code" / "notes.txt").exists()


def test_what_is_used_stays(places):
    allow(places["NUMBA_CACHE_DIR"])
    for name in ("used", "other"):
        cache.save(VERSION, name, b"code")
    for file in cache.files(VERSION):
        os.utime(file, (0.0, 0.0))
    assert cache.load(VERSION, "used") == b"code"
    cache.prune(file.parent)
    assert [file.name for file in cache.files(VERSION)] == [f"{VERSION}-used.code"]


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
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    assert cache.base_folders() == [tmp_path / "dimersweep", tmp_path / "tmp" / f"dimersweep-{os.getuid()}"]
    printed = run_python(f"from {cache.__name__} import base_folders; print(*base_folders(), sep='\\n')")
    assert printed.split() == [str(folder) for folder in cache.base_folders()]
    assert not pipelines.is_compiled()


@pytest.mark.jit
def test_code_goes_to_a_keyed_temporary_folder_where_no_other_can_be_written(copy, places):
    scratch = allow(places["TMPDIR"]) / f"dimersweep-{os.getuid()}"
    assert twice(copy)[0] == 2
    (code,) = scratch.glob("*-twice-*")
    made = code.stat().st_ino
    assert twice(copy)[0] == 2
    assert code.stat().st_ino == made, "compiled again"
    assert list(scratch.iterdir()) == [code]
    assert scratch.stat().st_mode & 0o777 == 0o700
    assert not list(copy.rglob("*.nb?"))


@pytest.mark.jit
def test_code_is_not_kept_where_nothing_can_be_written(copy, places):
    program = "import warnings; warnings.simplefilter('error'); from dimersweep.kernel.room.above import twice; "
    told = run_python(
        program + "\ntry: twice()\nexcept RuntimeWarning as line: print(line)\nprint(twice())", tree=copy
    ).splitlines()
    assert told[0].startswith(f"compiled code cannot be kept in {places['NUMBA_CACHE_DIR']}/dimersweep or ")
    assert told[1:] == ["2"]
    assert not list(copy.rglob("*.nb?")) and not list(copy.rglob("*.code"))


def refused(*_):
    raise PermissionError("a file of another user")


def test_code_is_read_from_a_folder_that_others_have_filled(places, monkeypatch):
    allow(places["NUMBA_CACHE_DIR"])
    cache.save(VERSION, "name", b"code")
    monkeypatch.setattr(os, "utime", refused)
    assert cache.load(VERSION, "name") == b"code"


@pytest.mark.parametrize("fault", ["others may write", "a link"])
def test_code_from_a_temporary_folder_of_others_is_not_run(tmp_path, places, fault):
    scratch = allow(places["TMPDIR"]) / f"dimersweep-{os.getuid()}"
    cache.save(VERSION, "name", b"code")
    assert cache.load(VERSION, "name") == b"code" and len(cache.files(VERSION)) == 1
    if fault == "a link":
        scratch.rename(tmp_path / "elsewhere")
        scratch.symlink_to(tmp_path / "elsewhere")
    else:
        scratch.chmod(0o777)
    assert cache.load(VERSION, "name") is None and not cache.files(VERSION)
    with pytest.warns(RuntimeWarning, match=r"^compiled code cannot be kept in .*, so every process compiles;"):
        cache.save(VERSION, "other", b"code")


@pytest.mark.skipif(os.getuid() != 0, reason="needs to be another user")
def test_code_from_a_folder_of_another_user_is_not_run(places):
    scratch = allow(places["TMPDIR"]) / f"dimersweep-{os.getuid()}"
    cache.save(VERSION, "name", b"code")
    os.chown(scratch, 12345, 12345)
    assert cache.load(VERSION, "name") is None


@pytest.mark.usefixtures("fake_kernel")
def test_cubes_are_read_where_nothing_can_be_written_and_nobody_is_home(small_cubes, copy, places):
    cube = small_cubes / "fig07-small.nc"
    nobody = "import pwd\ndef unknown(uid): raise KeyError(uid)\npwd.getpwuid = unknown\n"
    read = f"import dimersweep\nprint(dimersweep.open_cube({str(cube)!r}).sizes['f'])\n"
    status = f"from dimersweep.cli import main\nimport sys\nsys.argv = ['dimersweep', 'status', {str(cube)!r}]\nmain()"
    environment = dict.fromkeys(("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"))
    code = "\nfrom dimersweep.kernel.room.above import twice\nprint(twice())"
    printed = run_python(nobody + read + status + code, tree=copy, **environment).splitlines()
    assert printed[:2] == ["3", f"{cube}: complete, 132 points"] and printed[-1] == "2"


def flipped(content, at, bit):
    changed = bytearray(content)
    changed[at] ^= 1 << bit
    return bytes(changed)


def test_damaged_code_is_not_read(places):
    allow(places["NUMBA_CACHE_DIR"])
    code = bytes(range(256)) * 20
    cache.save(VERSION, "name", code)
    cache.save(VERSION, "other", b"code of another function")
    (path,), (other,) = cache.files(VERSION, "name"), cache.files(VERSION, "other")
    content = path.read_bytes()
    rng = np.random.default_rng(1)
    damaged = [
        flipped(content, at, bit)
        for at, bit in zip(rng.integers(0, len(content), 200), rng.integers(0, 8, 200), strict=True)
    ]
    damaged += [content[:length] for length in (0, 1, 31, 32, 33, len(content) // 2, len(content) - 1)]
    damaged += [content + b"x", bytes(len(content)), other.read_bytes()]
    for each in damaged:
        path.write_bytes(each)
        assert cache.load(VERSION, "name") is None
    cache.save(VERSION, "name", code)
    assert cache.load(VERSION, "name") == code


@pytest.mark.jit
def test_damaged_code_is_made_again(tmp_path, copy):
    environment = {"NUMBA_CACHE_DIR": str(tmp_path)}
    twice(copy, **environment)
    (path,) = tmp_path.glob("dimersweep/*-twice-*")
    content = path.read_bytes()
    damaged = flipped(content, len(content) // 2, 3)
    path.write_bytes(damaged)
    assert twice(copy, **environment)[0] == 2
    assert len(path.read_bytes()) == len(content) and path.read_bytes() != damaged


def test_a_long_compilation_is_told_until_it_is_done(monkeypatch, capsys):
    state = {"ready": threading.Event(), "under_way": threading.Event()}
    for name, event in state.items():
        monkeypatch.setattr(cache, name, event)
    monkeypatch.setattr(progress, "COMPILE_STEP", 0.01)
    monkeypatch.setattr(progress, "is_compiled", lambda: True)
    progress.report_compiling()
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress, "is_compiled", lambda: False)
    before = set(threading.enumerate())
    progress.report_compiling()
    (teller,) = set(threading.enumerate()) - before
    time.sleep(0.1)  # other work comes first
    told = capsys.readouterr().err
    assert told == "compiling the kernel: 10 to 60 s, once for each version\n"
    state["under_way"].set()
    while "so far" not in (told := capsys.readouterr().err):
        time.sleep(0.01)
    state["ready"].set()
    teller.join(60.0)
    assert re.match("compiling the kernel: [0-9]+ s so far\n", told)
    assert not teller.is_alive()


def test_nothing_is_compiled_with_the_jit_off(tmp_path):
    program = f"from {pipelines.__name__} import is_compiled; print(is_compiled())"
    assert run_python(program, NUMBA_CACHE_DIR=str(tmp_path), NUMBA_DISABLE_JIT="1") == "True\n"
    assert run_python(program, NUMBA_CACHE_DIR=str(tmp_path), TMPDIR=str(tmp_path), NUMBA_DISABLE_JIT=None) == "False\n"
