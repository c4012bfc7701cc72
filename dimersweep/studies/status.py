"""How far a sweep has come, read from its files while it runs or after it was stopped."""

import os
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

from dimersweep.errors import StoreError
from dimersweep.storage.cubefiles import count_modes
from dimersweep.storage.locking import holder
from dimersweep.storage.manifest import Entry, read_manifest
from dimersweep.storage.tilestore import tiles_of
from dimersweep.work.progress import clock


def status(path: Path) -> list[str]:
    """What is done of the sweep for the cube `path`, in lines; nothing is changed.

    Parameters
    ----------
    path : Path
        The cube to be, or the folder of its finished points.

    Raises
    ------
    StoreError
        If there is no sweep of that name, or its files are damaged.
    """
    out = path.with_suffix("") if path.suffix == ".tiles" else path
    if not out.name:
        raise StoreError(f"{out}: is no cube")
    if not os.path.exists(tiles_of(out).manifest):
        if os.path.exists(out):
            return _of_cube(out)
        raise StoreError(f"{out}: no such cube, and no sweep for it ({tiles_of(out).path} has no manifest)")
    return _of_tiles(out)


def _of_cube(out: Path) -> list[str]:
    tally = Counter(count_modes(out))
    return [f"{out}: complete, {tally.total()} points", f"modes: {_words(tally)}"]


def _of_tiles(out: Path) -> list[str]:
    tally: Counter[str] = Counter()
    last = ""

    def take(entry: Entry) -> None:
        nonlocal last
        tally.update(entry.modes)
        last = entry.time

    try:
        manifest = read_manifest(tiles_of(out).manifest, take)
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{tiles_of(out).manifest}: cannot be read ({error.strerror})") from None
    done = tally.total()
    lines = [f"{out}: {manifest.words_for(done)} done ({100 * done // max(manifest.wanted, 1)} %)"]
    if done:
        lines += [f"modes: {_words(tally)}", f"last tile: {_ago(last)}"]
    lines.append(f"failed: {tally['failed']} points")
    if manifest.damaged:
        lines.append(
            f"manifest: lines that are cut or damaged: {manifest.damaged}; their points will be computed again"
        )
    who = holder(tiles_of(out).lock)
    if done == manifest.wanted and not who:
        lines.append("cube: is written" if out.exists() else "cube: is still to be written; run the same sweep again")
    else:
        lines.append(f"at work: {who}" if who else "at work: nobody; run the same sweep again to go on")
    return lines


def _ago(time: str) -> str:
    seconds = (datetime.now(UTC) - datetime.fromisoformat(time)).total_seconds()
    return f"{clock(seconds)} ago" if seconds >= 0 else f"{time}, by a clock that has been set back since"


def _words(tally: Counter[str]) -> str:
    return ", ".join(f"{mode} {count}" for mode, count in tally.most_common())
