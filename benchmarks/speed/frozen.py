"""Whether a revision answers as a former one did: ``frozen.py make FOLDER`` at the one, ``compare FOLDER`` at the other.

`make` writes down what the revision that is imported answers, number by number: runs over the whole domain of the model, the
modes of Fig. 7, cubes of every kind and format, saved runs, tables, and all borders of random dimers. It keeps the files of
cubes, runs and tables, too, and sweeps that were killed midway. Called again it makes what is not there yet.

`compare` asks the same anew. It reads the former files as well, and goes on with the sweeps that were killed; the folder stays
as it is. For each answer it says whether it has the same bits, is within 1e-6, or differs, and in what. It ends with 1 at a
difference whose reason ``--explained FILE`` does not tell, in lines such as
``borders, dimer 7 flip: another flip, which comes first``: a name, or a pattern of names, and the reason.

PYTHONPATH chooses the revision: ``PYTHONPATH=. python benchmarks/speed/frozen.py compare FOLDER --part cubes``.
"""

import argparse
import json
import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from frozen_cases import PARTS, Answer, Case

WITHIN = 1e-6
LEAST = 1e-3  # below this size a difference counts as one of this size, not as a share
SHOWN = 4  # numbers that differ, of each answer
SAME, NEAR, OTHER = "the same bits", "within 1e-6", "differ"

Cases = Mapping[str, Iterable[Case]]


def answered(file: Path) -> dict[str, Answer]:
    """The answers that were written down."""
    return dict(json.loads(line) for line in file.read_text().splitlines()) if file.exists() else {}


def make(folder: Path, cases: Cases) -> None:
    """Answer what is not answered yet, each part in a file of its own."""
    files = folder / "files"
    files.mkdir(parents=True, exist_ok=True)
    for part, each in cases.items():
        answers = folder / f"{part}.jsonl"
        known, made = answered(answers), 0
        with answers.open("a") as kept:
            for case in each:
                if case.name not in known:
                    print(json.dumps([case.name, case.make(files)]), file=kept, flush=True)
                    made += 1
        print(f"{part}: {len(known) + made} answers, {made} of them new", flush=True)


def leaves(answer: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Each text, number and list of an answer, by its name."""
    if not isinstance(answer, dict):
        yield name, answer
        return
    for key, value in answer.items():
        yield from leaves(value, f"{name}.{key}".lstrip("."))


def apart(was: Any, now: Any) -> float:
    """The largest difference of numbers, as a share of their size; infinite where other things differ."""
    if json.dumps(was) == json.dumps(now):
        return 0.0
    try:
        a, b = np.asarray(was, dtype=float), np.asarray(now, dtype=float)
    except (ValueError, TypeError):
        return np.inf
    if a.shape != b.shape or isinstance(was, str) or (np.isfinite(a) != np.isfinite(b)).any():
        return np.inf
    finite = np.isfinite(a)
    if not np.array_equal(a[~finite], b[~finite], equal_nan=True):
        return np.inf
    return max(np.max(np.abs(a - b)[finite] / np.maximum(np.abs(a[finite]), LEAST), initial=0.0), np.finfo(float).tiny)


def shown(value: Any) -> str:
    """A value in a few words."""
    text = f"{value:.9g}" if isinstance(value, float) else json.dumps(value)
    return text if len(text) < 60 else f"{text[:57]}..."


def judged(was: Answer, now: Answer) -> tuple[str, list[str]]:
    """Whether two answers are the same, and what differs in words."""
    former, later = dict(leaves(was)), dict(leaves(now))
    far = {name: apart(former[name], later[name]) for name in former.keys() & later.keys()}
    others = sorted((name for name in far if not far[name] <= WITHIN), key=lambda name: (-far[name], name))
    told = [f"{name} {shown(former[name])} -> {shown(later[name])} ({far[name]:.1e})" for name in others[:SHOWN]]
    told += [f"{len(others) - SHOWN} more"] if len(others) > SHOWN else []
    for words, names in (("lacks", former.keys() - later.keys()), ("has besides", later.keys() - former.keys())):
        told += [f"{words} {', '.join(sorted(names)[:SHOWN])}{' ...' if len(names) > SHOWN else ''}"] if names else []
    if told:
        return OTHER, told
    return (NEAR if any(far.values()) else SAME), [f"{max(far.values(), default=0.0):.1e}"]


def asked_anew(case: Case, former: Path, scratch: Path) -> Iterator[tuple[str, Answer]]:
    """What a case answers now, and what its former file holds."""
    yield case.name, case.go_on(former) if case.go_on else case.make(scratch)
    if case.read:
        yield f"{case.name} as it was kept", case.read(former)


def explanations(file: Path | None) -> list[tuple[str, str]]:
    """Patterns of names, and reasons."""
    lines = file.read_text().splitlines() if file else []
    return [tuple(each.strip() for each in line.split(":", 1)) for line in lines if ":" in line]  # type: ignore[misc]


def compare(folder: Path, cases: Cases, explained: list[tuple[str, str]]) -> int:
    """Say of each answer how it compares; how many differ for no reason that is told."""
    unexplained = 0
    with TemporaryDirectory() as name, warnings.catch_warnings(action="ignore"):  # of files of another kernel
        former, scratch = Path(name) / "former", Path(name) / "now"
        scratch.mkdir()
        shutil.copytree(folder / "files", former)
        for part, each in cases.items():
            known, counts = answered(folder / f"{part}.jsonl"), dict.fromkeys((SAME, NEAR, OTHER), 0)
            for case in each:
                if case.name not in known:
                    continue
                for asked, answer in asked_anew(case, former, scratch):
                    verdict, told = judged(known[case.name], answer)
                    if "refused" in answer:  # a sweep that was begun by another revision may be, in a line
                        print(f"{part}, {asked}: is refused: {answer['refused']}", flush=True)
                        continue
                    counts[verdict] += 1
                    if verdict == OTHER:
                        full = f"{part}, {asked}"
                        why = next((why for pattern, why in explained if fnmatchcase(full, pattern)), "")
                        unexplained += not why
                        print(f"{full}: {'; '.join(told)}{f' [{why}]' if why else ''}", flush=True)
            print(f"{part}: {', '.join(f'{count} {verdict}' for verdict, count in counts.items())}", flush=True)
    print(f"{unexplained} answers differ for no reason that is told")
    return unexplained


def main(arguments: list[str] | None = None) -> int:
    """Make or compare; 1 if an answer differs for no reason that is told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("verb", choices=("make", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", action="append", choices=PARTS, help="one of the parts; may be given more than once")
    parser.add_argument("--first", type=int, metavar="N", help="the first N answers of each part")
    parser.add_argument("--explained", type=Path, metavar="FILE", help="reasons of differences")
    given = parser.parse_args(arguments)
    cases = {part: list(PARTS[part]())[: given.first] for part in given.part or PARTS}
    if given.verb == "make":
        make(given.folder, cases)
        return 0
    return int(compare(given.folder, cases, explanations(given.explained)) > 0)


if __name__ == "__main__":
    sys.exit(main())
