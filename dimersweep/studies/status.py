"""How far a sweep has come, read from its files while it runs or after it was stopped."""

import os
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

from dimersweep.errors import StoreError
from dimersweep.storage.cubefiles import count_modes
from dimersweep.storage.store import Store, holder, looked_at
from dimersweep.storage.tilestore import modes_of, tiles_of, words_for
from dimersweep.work.progress import clock


def status(path: Path) -> list[str]:
    """What is done of the sweep for the cube `path`, in lines; nothing is changed.

    Parameters
    ----------
    path : Path
        The cube to be, or the store of its finished points.

    Raises
    ------
    StoreError
        If there is no sweep of that name, or its files are damaged.
    """
    out = path.with_suffix("") if path.suffix == ".tiles" else path
    if not out.name:
        raise StoreError(f"{out}: is no cube")
    if os.path.lexists(tiles_of(out)):
        with looked_at(tiles_of(out)) as store:
            return _of_tiles(out, store)
    if os.path.exists(out):
        tally = Counter(count_modes(out))
        return [f"{out}: complete, {tally.total()} points", f"modes: {_words(tally)}"]
    raise StoreError(f"{out}: no such cube, and no sweep for it (there is no {tiles_of(out)})")


def _of_tiles(out: Path, store: Store) -> list[str]:
    tally: Counter[str] = Counter()
    last, unreadable, wanted = "", 0, store.about["wanted"]
    for row in store.summaries():
        try:
            modes, at = modes_of([row]), datetime.fromisoformat(row.at)
            sound = modes.total() == row.stop - row.start
        except (ValueError, TypeError, AttributeError):
            sound = False
        if sound:
            tally, last = tally + modes, max(last, at.isoformat())
        unreadable += not sound
    done = tally.total()
    lines = [f"{out}: {words_for(store, done)} done ({100 * done // wanted} %)"]
    if done:
        lines += [f"modes: {_words(tally)}", f"last tile: {_ago(last)}"]
    lines.append(f"failed: {tally['failed']} points")
    if unreadable or store.is_cut:
        lines.append(f"{store.path}: is damaged; what is lost will be computed again")
    who = holder(store.path)
    if done == wanted and not who:
        lines.append("cube: is written" if out.exists() else "cube: is still to be written; run the same sweep again")
    else:
        lines.append(f"at work: {who}" if who else "at work: nobody; run the same sweep again to go on")
    return lines


def _ago(time: str) -> str:
    seconds = (datetime.now(UTC) - datetime.fromisoformat(time)).total_seconds()
    return f"{clock(seconds)} ago" if seconds >= 0 else f"{time}, by a clock that has been set back since"


def _words(tally: Counter[str]) -> str:
    return ", ".join(f"{mode} {count}" for mode, count in tally.most_common())
