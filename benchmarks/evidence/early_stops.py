"""What runs that stop early tell, beside whole runs: ``python benchmarks/evidence/early_stops.py --scenes 10000``.

Random scenes of four families, each run to where it stops and to its last period. Compared are all words and all numbers of
the outcome. Prints, as tables of docs/stopping.md, how many differ, by how much, and each change of a word with its numbers.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from dimersweep.kernel.model.layout import CODE_WORDS, MODES
from tests.checks.early_stops import FAMILIES, NUMBERS, WITHIN, WORDS, apart, both_ways, scenes

CHUNK = 100  # scenes to a task


def joined(parts):
    """The outcomes of all tasks, one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def compared(chunk, rows, periods):
    """One task: the outcomes of runs that stopped early, of the whole ones, how far apart they are."""
    both = both_ways(rows[chunk], periods)
    return both.stopped, both.whole, apart(both), {"which": chunk[both.which]}


def word(name, code):
    """The word of a code, or the number itself."""
    return CODE_WORDS[name][code] if name in CODE_WORDS else str(code)


def main():
    """Compare, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=10_000)
    parser.add_argument("--periods", type=int, default=300)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    rows, family = scenes(given.scenes, given.seed)
    chunks = [np.arange(k, min(k + CHUNK, len(rows))) for k in range(0, len(rows), CHUNK)]
    with ProcessPoolExecutor(given.threads) as pool:
        parts = list(pool.map(partial(compared, rows=rows, periods=given.periods), chunks))
    stopped, whole, far, which = (joined(part) for part in zip(*parts, strict=True))
    show(rows, family, given.periods, which["which"], stopped, whole, far)


def show(rows, family, periods, which, stopped, whole, far):
    """Print the tables."""
    n = len(rows)
    print(f"{n} runs of {periods} periods at most, of which {len(which)} stopped early\n")
    print("| mode | stopped early | after, of the periods asked for |\n|---|---|---|")
    for code in np.unique(stopped["mode"]):
        made = stopped["n_periods"][stopped["mode"] == code]
        print(f"| `{MODES[code]}` | {len(made)} | {made.mean() / periods:.2f} |")
    print(f"| all | {len(which)} | {stopped['n_periods'].mean() / periods:.2f} |")
    print("\n| outcome | differs | share of all | largest difference | at most |\n|---|---|---|---|---|")
    for name in (*WORDS, *NUMBERS):
        limit = 0.0 if name in WORDS else WITHIN
        differs = int((far[name] > limit).sum())
        size = ("", "") if name in WORDS else (f"{far[name].max():.1e}", f"{WITHIN:g}")
        print(f"| `{name}` | {differs} | {100 * differs / n:.2f} % | {size[0]} | {size[1]} |")
    any_word = np.any([far[name] > 0 for name in WORDS], axis=0)
    any_number = np.any([far[name] > WITHIN for name in NUMBERS], axis=0)
    print(
        f"\na word differs in {100 * any_word.sum() / n:.2f} % of the runs, a number in {100 * any_number.sum() / n:.2f} %"
    )
    for name in WORDS:
        changes = Counter(
            (word(name, a), word(name, b)) for a, b in zip(stopped[name], whole[name], strict=True) if a != b
        )
        for (a, b), count in changes.most_common():
            print(f"{name}: {a} where the whole run has {b}: {count}")
    print("\nscene, family, mode and periods of it, periods made, change_ahead; what differs")
    for k in np.flatnonzero(any_word | any_number):
        told = [
            f"{name} {word(name, stopped[name][k])} -> {word(name, whole[name][k])}"
            for name in WORDS
            if far[name][k] > 0
        ]
        told += [f"{name} {stopped[name][k]:.5g} -> {whole[name][k]:.5g}" for name in NUMBERS if far[name][k] > WITHIN]
        head = f"{which[k]}, {FAMILIES[family[which[k]]]}, {MODES[stopped['mode'][k]]} of {stopped['mode_period'][k]}"
        print(f"{head}, {stopped['n_periods'][k]}, {stopped['change_ahead'][k]:.1e}; {'; '.join(told)}")


if __name__ == "__main__":
    main()
