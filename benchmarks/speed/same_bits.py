"""Whether two revisions give the same results to the last bit: ``python benchmarks/speed/same_bits.py REV_A REV_B``.

Runs are made over the whole domain of the model (``stress.py``), about as far from the base case as a laboratory would go,
and close to the base case. They differ in accuracy, in length, in whether they stop when settled and in whether they are
recorded; some are followed along their orbit's stability. Then every small declared sweep is made. Of all of them the
outcome, the events, the starts of the smooth phases, and the states at many times are compared.

Each revision runs in a process of its own through its public names, so the modules may lie anywhere. A folder may stand for
a revision, and so may a file of answers that ``--keep`` has written.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent


def digest(*arrays: Any) -> str:
    """Short hash of numbers and texts, by their bits."""
    total = hashlib.sha256()
    for array in arrays:
        values = np.ascontiguousarray(array)
        total.update(f"{values.dtype.str}{values.shape}".encode() + values.tobytes())
    return total.hexdigest()[:16]


def table(kind: str, dataset: Any) -> dict[str, str]:
    """Hash of each variable of a dataset, of flags that of their words: revisions need not have the same ones."""
    from dimersweep import names

    each = {str(name): dataset[name] for name in dataset.variables}
    told = {name: names(found) if "flag_meanings" in found.attrs else found for name, found in each.items()}
    return {f"{kind}: {name}": digest(found.values) for name, found in told.items()}


def bits_of(question: dict[str, Any]) -> dict[str, str]:
    """Hashes of what one run answers."""
    from dimersweep import simulate, stability

    run = simulate(**question["scene"])
    outcome = [run.status, run.mode, run.mode_period, run.n_events, run.n_periods, run.settled_after]
    found = {
        "outcome": digest(*outcome),
        "orbit": digest(*(astuple(run.orbit) if run.orbit else ())),
        "shares": digest(run.down_share_1, run.down_share_2),
    }
    if not question["scene"]["record"]:
        return found
    found["segments"] = digest(run.record("segments").segments)
    found |= table("events", run.events)
    if len(run.record("segments").segments):
        times = run.events["time"].values
        shares = times[-1] * np.array(question["shares"])
        for name, wanted in (("states", shares), ("event states", times), ("before", np.nextafter(times, 0.0))):
            try:
                found |= table(name, run.states(wanted))
            except RuntimeError as reason:
                found[name] = str(reason)
    if question["stability"]:
        for name in ("multipliers", "lyapunov"):
            try:
                answer = getattr(stability, name)(run, **({"periods": 100} if name == "lyapunov" else {}))
                found[name] = digest(*answer)
            except (ValueError, RuntimeError) as reason:
                found[name] = type(reason).__name__
    return found


def presets(sweeps: Path, folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Hashes of the variables of every small declared sweep that the revision knows, but for the version of its kernel."""
    from dimersweep import open_cube

    for declared in sorted(sweeps.glob("*-small.toml")):
        out = folder / f"{declared.stem}.nc"
        command = [sys.executable, "-m", "dimersweep", "run", str(declared), "--out", str(out), "--no-plot"]
        if subprocess.run(command, check=False, capture_output=True, cwd=folder).returncode:
            continue
        cube = open_cube(out)
        yield declared.stem, {str(name): digest(cube[name].values) for name in cube.variables if name != "kernel"}


def answer(asked: Sequence[dict[str, Any]], sweeps: Path | None) -> None:
    """Print the hashes of everything, a line of JSON each."""
    import dimersweep  # noqa: F401  # before all else: it names the folder of compiled code

    for k, question in enumerate(asked):
        print(json.dumps([f"run {k}", bits_of(question)]), flush=True)
    if sweeps:
        with tempfile.TemporaryDirectory() as folder:
            for name, found in presets(sweeps, Path(folder)):
                print(json.dumps([name, found]), flush=True)


def answers_of(revision: str, asked: Path, sweeps: Path | None) -> dict[str, dict[str, str]]:
    """The hashes of a revision, a folder or a file of answers."""
    from compare import checked_out

    if Path(revision).is_file():
        return json.loads(Path(revision).read_text())
    with tempfile.TemporaryDirectory() as folder, checked_out(revision, Path(folder) / "tree") as tree:
        command = [sys.executable, "-P", str(Path(__file__).resolve()), "--answer", str(asked), str(sweeps or "")]
        environment = os.environ | {"PYTHONPATH": str(tree)}
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    return dict(json.loads(line) for line in done.stdout.splitlines())


def differences(one: dict[str, dict[str, str]], other: dict[str, dict[str, str]]) -> list[str]:
    """Which parts differ, and in how many runs or sweeps, of what both revisions have."""
    apart: dict[str, list[str]] = {}
    for name in one.keys() & other.keys():
        for part in one[name].keys() & other[name].keys():
            if one[name][part] != other[name][part]:
                apart.setdefault(part, []).append(name)
    return [f"{part}: in {len(names)}, such as {min(names)}" for part, names in sorted(apart.items())]


def alone(one: dict[str, dict[str, str]], other: dict[str, dict[str, str]]) -> list[str]:
    """What only one of the revisions has: sweeps, and parts of runs."""
    parts = [{part for found in answers.values() for part in found} | set(answers) for answers in (one, other)]
    return sorted(parts[0] ^ parts[1])


def main(arguments: list[str] | None = None) -> None:
    """Compare, tell what differs, and exit with 1 if anything does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs="*", metavar="REV", help="two revisions, folders or files of answers")
    parser.add_argument("--runs", type=int)
    parser.add_argument("--no-presets", action="store_true", help="leave out the small declared sweeps")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write the answers of the last revision to a file")
    parser.add_argument("--answer", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.answer:
        asked, sweeps = given.answer
        answer(json.loads(Path(asked).read_text()), Path(sweeps) if sweeps else None)
        return
    from tests.checks.questions import RUNS, questions  # here: a process of an older revision has no such module

    if len(given.revisions) != 2 and not (given.keep and given.revisions):
        parser.error("two revisions are compared; one alone can be kept with --keep")
    sweeps = None if given.no_presets else HERE.parents[1] / "sweeps"
    with tempfile.NamedTemporaryFile("w", suffix=".json") as asked:
        json.dump(questions(given.runs or RUNS), asked)
        asked.flush()
        found = [answers_of(revision, Path(asked.name), sweeps) for revision in given.revisions]
    if given.keep:
        given.keep.write_text(json.dumps(found[-1], indent=0) + "\n")
    if len(found) == 2:
        apart = differences(*found)
        both = len(found[0].keys() & found[1].keys())
        print("\n".join(apart) if apart else f"the same bits: {both} runs and sweeps")
        if one_only := alone(*found):
            print(f"in one revision only: {', '.join(one_only)}")
        sys.exit(bool(apart))


if __name__ == "__main__":
    main()
