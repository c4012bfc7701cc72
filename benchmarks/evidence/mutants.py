"""Which tests of ``./go test`` see a mutant of meaning, and in how many seconds: ``python benchmarks/evidence/mutants.py``.

`mutants.toml` lists them: each changes a part of one line of the package, and what it means. A mutant is put into a copy of the
checkout, where the test that has seen it before runs first, then those of its file, then all others, the quick ones before
those that are marked slow, up to the first that fails. That must pass without the mutant, else it does not count and the next
one is looked for. Tests marked `release` are left out, and so are those that compare texts or bits of the kernel: any edit
fails them, whatever it means.

A mutant of the kernel is tried without the JIT first, and then compiled into a cache of its own. Each process that runs the
package proves its kernel by known bits (`work/proving.py`), which sees any of them: that is left out for the tests, and told
beside them; alone it counts half. What was found is kept in `build/mutants.json`, so that some can be tried again:
``--only 3,7-9`` or ``--only kernel``. `mutants.md` is written of all that are known.
"""

import argparse
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import monotonic
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
LIST, TABLE = (Path(__file__).with_suffix(ending) for ending in (".toml", ".md"))
FOUND = ROOT / "build" / "mutants.json"
SECONDS = 600.0  # for one mutant
# tests that see any edit: of this list, of patches to the package, and of bits of the kernel
OF_TEXT = ("benchmarks/tests/test_mutants.py", "tests/test_changes.py")
OF_BITS = ("tests/test_other_processors.py", "tests/kernel/test_fusing.py", "tests/test_cache.py")
# files of tests, in `tests`, that are about a file of the package: these run first
NEAREST = {
    "cli/interrupting.py": "test_cli",
    "analysis/commands/measuring.py": "test_commands test_harmonics",
    "cli/simulating.py": "test_commands test_cli",
    "cubes/cube.py": "test_accessor test_cube test_walk",
    "cubes/findings.py": "test_reading test_plots",
    "exploring/explore.html": "test_explore",
    "exploring/mapping.py": "test_explore",
    "analysis/fits/fitting.py": "analysis/test_fits",
    "analysis/fits/likelihood.py": "analysis/test_fits",
    "analysis/fits/pictures.py": "test_pictures analysis/test_fits",
    "analysis/fits/tracks.py": "analysis/test_fits",
    "analysis/fits/waveform.py": "test_harmonics",
    "kernel/contact/forces.py": "kernel/test_contact kernel/test_friction test_energy test_general",
    "kernel/flight/free_motion.py": "kernel/test_flight test_properties",
    "kernel/impact/double_equations.py": "kernel/test_double_impact test_general",
    "kernel/model/body.py": "kernel/test_body test_general",
    "kernel/model/plate.py": "kernel/test_plate test_harmonics",
    "kernel/verdict/classify.py": "kernel/test_verdict test_run",
    "kernel/verdict/track.py": "analysis/test_track test_walk",
    "analysis/orbits/slow/fate.py": "analysis/test_orbit_families analysis/test_following_sustained",
    "analysis/orbits/map/orbit.py": "analysis/test_orbit_numbers analysis/test_doubling test_mean_path analysis/test_fits",
    "analysis/orbits/slow/sustained.py": "analysis/test_sustained analysis/test_following_sustained",
    "parameters.py": "analysis/test_attractors test_harmonics",
    "analysis/attractors/pictures.py": "test_pictures analysis/test_attractors",
    "plots/maps.py": "test_pictures test_plots",
    "plots/modes.py": "test_pictures",
    "plots/movie.py": "test_movies",
    "plots/orbits.py": "test_pictures",
    "plots/runs.py": "test_pictures",
    "plots/view.html": "test_explore test_movies",
    "runs/growth.py": "test_stability",
    "runs/recorded.py": "test_run",
    "runs/saving.py": "test_held_run",
    "runs/sections.py": "test_energy test_run",
    "runs/shadows.py": "test_certify test_shadows",
    "runs/starting.py": "test_starts",
    "storage/formats/zarr.py": "test_zarrs",
    "storage/store.py": "test_tilestore test_store test_sweep",
    "analysis/attractors/shares.py": "analysis/test_attractors",
    "studies/deciding.py": "test_search test_reuse",
    "studies/loops.py": "test_carrying",
    "studies/observers.py": "test_plots test_datasets test_walk",
    "studies/refine.py": "test_refine",
    "symbols.py": "test_dimensions test_optional_parameters test_general test_cube",
    "work/computing.py": "test_sweep test_scheduling",
    "work/parts.py": "test_parts",
    "work/progress.py": "test_sweep",
    "work/scheduling.py": "test_scheduling",
}
PROVE = "from dimersweep.work.proving import prove; prove()"


class Mutant(NamedTuple):
    """A change of a part of one line."""

    number: int
    room: str
    file: str  # in the package
    was: str
    becomes: str
    means: str
    seen_by: str = ""  # the test that has seen it before


class Killed(NamedTuple):
    """What became of a mutant."""

    by: str  # a test; "" if none has seen it
    seconds: float
    proven: bool  # whether the proof of the kernel has seen it


def mutants() -> list[Mutant]:
    """Return all of the list."""
    rooms = tomllib.loads(LIST.read_text(encoding="utf-8")).items()
    every = ((room, each) for room, listed in rooms for each in listed)
    return [Mutant(number, room, **each) for number, (room, each) in enumerate(every, 1)]


def why_not(mutant: Mutant) -> str:
    """Return why a mutant cannot be made of the package as it is; "" if it can."""
    count = (ROOT / "dimersweep" / mutant.file).read_text(encoding="utf-8").count(mutant.was)
    if count != 1:
        return f"mutant {mutant.number}: {mutant.file} has {count} times {mutant.was!r}; must be once"
    if mutant.was == mutant.becomes or "\n" in mutant.was + mutant.becomes:
        return f"mutant {mutant.number}: {mutant.was!r}: must become another part of one line"
    return "" if mutant.file in NEAREST else f"mutant {mutant.number}: {mutant.file}: has no tests (see NEAREST)"


def copied(folder: Path) -> None:
    """Copy the checkout, without what is made of it."""
    left_out = shutil.ignore_patterns(".git", ".venv", "build", "__pycache__", ".*_cache", ".hypothesis")
    shutil.copytree(ROOT, folder, ignore=left_out, symlinks=True)


def run_in(folder: Path, seconds: float, command: list[str], settings: dict[str, str]) -> tuple[int | None, str]:
    """Run Python in a copy; its exit code, None if it took longer than it may, and what it printed."""
    here = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **settings}
    environment = {name: text for name, text in os.environ.items() if name != "DIMERSWEEP_CUBES"} | here
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "start_new_session": True}
    with subprocess.Popen([sys.executable, *command], cwd=folder, env=environment, **how) as process:  # type: ignore[call-overload]
        try:
            printed, _ = process.communicate(timeout=max(1.0, seconds))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None, process.communicate()[0]
    return process.returncode, printed


def first_failure(folder: Path, seconds: float, tests: list[str], settings: dict[str, str]) -> str:
    """Return the first test of some that fails, or ends the process; "" if none does in the time that there is."""
    if not tests:
        return ""
    command = ["-m", "pytest", "-p", "no:cacheprovider", "-x", "-q", "--tb=no", "-rfE", *tests]
    code, printed = run_in(folder, seconds, command, settings)
    if code in (None, 0, 4, 5):  # the time is up, all pass, there is no such test, none was chosen
        return ""
    failed = re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", printed, re.MULTILINE)
    return failed[0] if failed else f"pytest ended with {code}: {printed.strip().splitlines()[-1:]}"


def files_of(mutant: Mutant) -> tuple[list[str], list[str]]:
    """Return the files of tests that are nearest to a mutant, in their order, and all others."""
    rooms = ROOT / "tests", ROOT / "benchmarks" / "tests"
    every = {str(path.relative_to(ROOT)) for room in rooms for path in room.rglob("test_*.py")} - {*OF_TEXT}
    every -= {*OF_BITS} if is_of_kernel(mutant) else set()
    near = [f"tests/{name}.py" for name in NEAREST[mutant.file].split()]
    return near, sorted(every - {*near}, reverse=True)  # those of the package before those of its programs


def is_of_kernel(mutant: Mutant) -> bool:
    """Return whether the kernel is another one with a mutant."""
    return mutant.file.startswith("kernel/")


def rounds(mutant: Mutant, cache: str) -> Iterator[tuple[list[str], dict[str, str]]]:
    """Yield tests, as pytest is told them, and the settings with which they run, one round after the other."""
    settings: dict[str, str] = {}
    near, others = files_of(mutant)
    if is_of_kernel(mutant):
        settings = {"DIMERSWEEP_OTHER_PHYSICS": "1", "NUMBA_CACHE_DIR": cache}
    if mutant.seen_by:
        uncompiled = {"NUMBA_DISABLE_JIT": "1"} if mutant.seen_by.startswith("tests/kernel/") else {}
        yield ["-m", "not release", mutant.seen_by], uncompiled | settings
    plain = [name for name in near if name.startswith("tests/kernel/")]
    if is_of_kernel(mutant) and plain:
        yield ["-m", "not jit and not release", *plain], {"NUMBA_DISABLE_JIT": "1"} | settings
    yield ["-m", "not release and not slow", *near], settings
    yield ["-m", "not release and slow", *near], settings
    yield ["-m", "not release and not slow", *others], settings
    yield ["-m", "not release and slow", *others], settings


def killed(mutant: Mutant, folder: Path, seconds: float) -> Killed:
    """Put a mutant into a copy, and look for the test that sees it."""
    file = folder / "dimersweep" / mutant.file
    text = file.read_text(encoding="utf-8")
    mutated = text.replace(mutant.was, mutant.becomes)
    begun, by, proven = monotonic(), "", False
    with tempfile.TemporaryDirectory() as cache:
        try:
            for tests, settings in rounds(mutant, cache):
                deselected: list[str] = []
                while True:
                    file.write_text(mutated, encoding="utf-8")
                    by = first_failure(folder, seconds - (monotonic() - begun), [*tests, *deselected], settings)
                    taken = monotonic() - begun
                    file.write_text(text, encoding="utf-8")
                    without = {name: value for name, value in settings.items() if name != "NUMBA_CACHE_DIR"}
                    if (
                        by
                        and "::" not in by
                        and run_in(folder, SECONDS, ["-m", "pytest", "--collect-only", *tests], without)[0]
                        not in (0, 5)
                    ):
                        raise RuntimeError(f"tests cannot be run here, without a mutant: {by}")
                    if "::" not in by or not first_failure(folder, SECONDS, [by], without):
                        break
                    deselected += ["--deselect", by]  # fails without the mutant, too
                if by or taken > seconds:
                    break
            if is_of_kernel(mutant):
                file.write_text(mutated, encoding="utf-8")
                ways = (
                    {"NUMBA_DISABLE_JIT": "1"},
                    {"NUMBA_CACHE_DIR": cache},
                )  # the first has few scenes, and takes seconds
                proven = any(run_in(folder, SECONDS, ["-c", PROVE], way)[0] != 0 for way in ways)
        finally:
            file.write_text(text, encoding="utf-8")
    return Killed(by, taken, proven)


def chosen(only: str, listed: list[Mutant]) -> list[Mutant]:
    """Return the mutants that are asked for, such as 3,7-9 or kernel; all by default."""
    numbers: set[int] = set()
    for part in only.split(",") if only else ():
        if found := re.fullmatch(r"(\d+)(?:-(\d+))?", part):
            numbers |= {*range(int(found[1]), int(found[2] or found[1]) + 1)}
        else:
            numbers |= {each.number for each in listed if each.room == part}
    return [each for each in listed if not only or each.number in numbers]


def key_of(mutant: Mutant) -> str:
    """Return what a mutant is known by, whatever its number."""
    return json.dumps([mutant.file, mutant.was, mutant.becomes])


def table(listed: list[Mutant], found: dict[str, Killed]) -> str:
    """Return the table of what is known, and how many are seen."""
    lines = ["| | file | mutant | seen by | s |", "|--:|---|---|---|--:|"]
    score = 0.0
    for each in listed:
        told = found.get(key_of(each))
        by, seconds = (
            ("not tried", "") if told is None else (f"`{told.by}`" if told.by else "**nothing**", f"{told.seconds:.0f}")
        )
        if told is not None:
            score += 1.0 if told.by else 0.5 if told.proven else 0.0
            by += ", and the proof of bits" if told.proven else ""
        lines.append(f"| {each.number} | `{each.file}` | {each.means} | {by.replace('|', '&#124;')} | {seconds} |")
    return "\n".join([*lines, "", f"{score:g} of {len(listed)}"])


def main() -> int:
    """Try the mutants that are asked for, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", help="numbers, such as 3,7-9, and rooms")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="for one mutant")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    listed = mutants()
    if wrong := [line for each in listed if (line := why_not(each))]:
        print(*wrong, sep="\n", file=sys.stderr)
        return 2
    known = json.loads(FOUND.read_text(encoding="utf-8")) if FOUND.exists() else {}
    found = {name: Killed(*values) for name, values in known.items()}
    free: queue.SimpleQueue[Path] = queue.SimpleQueue()
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(asked.workers) as workers:
        for number in range(asked.workers):
            folder = Path(scratch) / f"copy-{number}"
            copied(folder)
            free.put(folder)

        def tried(mutant: Mutant) -> None:
            folder = free.get()
            told = found[key_of(mutant)] = killed(mutant, folder, asked.seconds)
            free.put(folder)
            print(f"{mutant.number:3} {told.seconds:5.0f} s  {told.by or 'nothing':80}  {mutant.means}", flush=True)
            FOUND.parent.mkdir(exist_ok=True)
            FOUND.write_text(json.dumps(dict(found), indent=1), encoding="utf-8")

        list(workers.map(tried, chosen(asked.only, listed)))
    said = (__doc__ or "").partition("\n")[0].partition(":")[0]
    body = table(listed, {key_of(each): found[key_of(each)] for each in listed if key_of(each) in found})
    text = f"# Mutants\n\n{said}: `python benchmarks/evidence/mutants.py` makes this table, and says how.\n\n{body}\n"
    TABLE.write_text(text, encoding="utf-8")
    print(body)
    return 0


if __name__ == "__main__":
    sys.exit(main())
