"""What a hostile hour does to a sweep: ``python benchmarks/evidence/faults.py``, some minutes, prints a table.

Each attack (``fault_attacks.py``, ``fault_cubes.py``, ``fault_clusters.py``) damages, kills or misuses a small sweep with the
real kernel, several times, each time in another place or at another moment. Then the same sweep is asked for again. It holds if
the cube that comes is the undisturbed one bit for bit, or if there is none, the exit status is not zero, and one line says why;
and if nothing beside the output, its picture and its store of tiles was written or deleted. The exit status is 1 if an attack
does not hold.
"""

import argparse
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import fault_attacks  # noqa: F401 - enters its attacks, as the next two do
import fault_clusters  # noqa: F401
import fault_cubes  # noqa: F401
from fault_scene import ATTACKS, SEARCH, TOML, Scene, Skipped, Stock, ended, forked, line_of


def is_same(cube: Path, reference: Path, told: Path) -> bool:
    """Whether two cubes have the same variables, bit for bit."""

    def compare() -> None:
        from dimersweep import open_cube

        ours, theirs = open_cube(cube).load(), open_cube(reference).load()
        same = set(ours.variables) == set(theirs.variables) and all(
            ours[name].dtype == theirs[name].dtype and ours[name].values.tobytes() == theirs[name].values.tobytes()
            for name in theirs.variables
        )
        sys.exit(0 if same else 3)

    return ended(forked(compare, told)) == 0


def asked(scene: Scene) -> str:
    """Ask for the status of the sweep, which changes nothing: "", or "FAILED: how"."""

    def call() -> None:
        from dimersweep.cli import main

        sys.argv = ["dimersweep", "status", str(scene.cube)]
        main()

    own = [path for path in (scene.cube, scene.tiles) if path.exists()]
    before = [(path, path.lstat().st_mtime_ns) for each in own for path in (each, *sorted(each.rglob("*")))]
    code = ended(forked(call, scene.folder / "told"))
    told = scene.told()
    if [(path, path.lstat().st_mtime_ns) for each in own for path in (each, *sorted(each.rglob("*")))] != before:
        return "FAILED: its status changed something"
    if "Traceback" in told or (code and not line_of(told)):
        return f"FAILED: status: exit {code}: {told.strip()[-300:]}"
    return ""


def judge(scene: Scene, references: dict[str, Path]) -> str:
    """Ask for the status, and for the sweep again: "same", "refused: why", or "FAILED: how"."""
    wrong = asked(scene)
    if wrong:
        return wrong
    code = scene.run(*scene.again)
    told = scene.told()
    beside = scene.snapshot()
    if beside != scene.precious:
        changed = sorted({*beside.items()} ^ {*scene.precious.items()})[0][0]
        return f"FAILED: {changed} was changed"
    if code == 0 and scene.hostile:
        return "FAILED: it was not refused"
    if code == 0:
        same = is_same(scene.cube, references[scene.reference], scene.folder / "told")
        return "same" if same else f"FAILED: other numbers, exit 0 {scene.told()[-200:]}"
    if line_of(told):
        return f"refused: {line_of(told)[19:]}"
    return f"FAILED: exit {code}: {told.strip()[-300:]}"


def references_in(folder: Path, stock: Stock) -> tuple[dict[str, Path], float]:
    """Undisturbed cubes, and the time that a sweep takes [s]."""
    found, length = {}, 0.0
    for name, more in (("sweep", ""), ("search", SEARCH)):
        place = folder / name
        place.mkdir()
        scene = Scene(place, random.Random(0), stock)
        scene.declare(TOML.format(out=scene.out) + more)
        begun = time.monotonic()
        if scene.run() != 0:
            raise SystemExit(f"the undisturbed {name} fails: {scene.told()}")
        length = length or time.monotonic() - begun
        found[name] = scene.cube
    print(f"an undisturbed sweep takes {length:.2f} s", flush=True)
    return found, length


def spent() -> tuple[float, float]:
    """The time, and that of processors which children have used [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.monotonic(), used.ru_utime + used.ru_stime


def main() -> None:
    """Attack, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=5, help="how often each attack is made")
    parser.add_argument("--kills", type=int, default=200, help="random kills in all, at least")
    parser.add_argument("--only", default="", help="attacks whose name has this in it")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--page", type=Path, help="a page, such as docs/faults.md, whose table and figures are to be those of this run"
    )
    given = parser.parse_args()
    from dimersweep.work.proving import prove

    for name in ("cli.sweeping", "cubes.findings", "plots", "storage.formats", "studies.declared", "studies.status"):
        import_module(f"dimersweep.{name}")
    prove()  # children find all loaded
    chosen = {name: attack for name, attack in ATTACKS.items() if given.only in name}
    verdicts: dict[str, Counter[str]] = {name: Counter() for name in chosen}
    first: dict[str, Counter[str]] = {}  # without the kills that fill up
    told: dict[str, str] = {}
    kills, started = 0, spent()
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # kills need no disk that is slow to write
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        stock = Stock(Path(folder, "stock"))
        stock.folder.mkdir()
        references, length = references_in(Path(folder), stock)

        def once(name: str, number: int) -> int:
            with tempfile.TemporaryDirectory(dir=folder) as place:
                scene = Scene(Path(place), random.Random(f"{given.seed} {name} {number}"), stock, length=length)
                try:
                    verdict = chosen[name](scene) or judge(scene, references)
                except Skipped as reason:
                    verdict = f"skipped: {reason}"
                except Exception as error:  # the others are still to be made
                    verdict = f"FAILED: {error!r}"
            verdicts[name][verdict.partition(":")[0]] += 1
            told[name] = verdict if verdict.startswith("FAILED") or name not in told else told[name]
            return scene.kills

        for name in chosen:
            begun = spent()
            kills += sum(once(name, number) for number in range(given.times))
            first[name] = verdicts[name].copy()
            wall, used = ((after - before) / given.times for after, before in zip(spent(), begun, strict=True))
            print(f"{_row(name, verdicts[name], told[name])}  {wall:.1f} s, {used:.1f} s on a core", flush=True)
        number, killers = given.times, [name for name in chosen if "killed" in name]
        while killers and kills < given.kills:
            kills += once(killers[number % len(killers)], number)
            number += 1
    failed = [name for name in chosen if verdicts[name]["FAILED"]]
    made = sum(counter.total() for counter in verdicts.values())
    summary = f"{time.monotonic() - started[0]:.0f} s, {spent()[1] - started[1]:.0f} s of processors\n"
    summary += f"{len(chosen)} attacks, {made} times in all, {kills} random kills: {len(failed) or 'none'} did not hold"
    print(summary)
    if given.page:
        asked = ["git", "rev-parse", "--short", "HEAD"]
        revision = subprocess.run(
            asked, cwd=Path(__file__).parent, capture_output=True, text=True, check=True
        ).stdout.strip()
        given.page.write_text(
            with_results(given.page.read_text(encoding="utf-8"), summary, revision, first), encoding="utf-8"
        )
    for name in failed:
        print(_row(name, verdicts[name], told[name]))
    sys.exit(1 if failed else 0)


def with_results(page: str, summary: str, revision: str, verdicts: Mapping[str, Mapping[str, int]]) -> str:
    """A page with the results of a run in place of those that it has: the last lines, the revision, and the table.

    Parameters
    ----------
    page, summary, revision : str
    verdicts : mapping of str to mapping
        How often each attack ended the same, refused or FAILED.
    """
    words = ("same", "refused", "FAILED")
    rows = (
        f"| {name} | {' | '.join(str(counts.get(word, 0)) for word in words)} |\n" for name, counts in verdicts.items()
    )
    head, rule = "| attack | the same | refused | not held |\n", "|---|---|---|---|\n"
    page = re.sub(r"```\n[^`]* random kills: [^`]*\n```", lambda _: f"```\n{summary}\n```", page)
    page = re.sub(r"revision `\w+`", f"revision `{revision}`", page)
    return re.sub(re.escape(head + rule) + r"(\|[^\n]*\n)*", lambda _: head + rule + "".join(rows), page)


def _row(name: str, counter: Counter[str], told: str) -> str:
    counts = "  ".join(f"{word} {counter[word]:3d}" for word in ("same", "refused", "FAILED"))
    reason = "" if told == "same" else told.partition(": ")[2].replace("\n", " ")[:110]
    return f"{name:58s} {counts}  {reason}"


if __name__ == "__main__":
    main()
