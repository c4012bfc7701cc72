"""Read from its files how far a sweep has come, while it runs or after it was stopped."""

import os
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dimersweep.errors import StoreError
from dimersweep.storage.cubefiles import count_modes
from dimersweep.storage.store import Store, holder, looked_at
from dimersweep.storage.tilestore import modes_of, tiles_of, words_for
from dimersweep.work.progress import clock


def status(path: Path) -> dict[str, Any]:
    """Return how far the sweep for the cube `path` has come; no file is changed.

    Parameters
    ----------
    path : Path
        The cube to be, or the store of its finished points.

    Returns
    -------
    dict
        `cube`: its path; `written`: True if the cube exists; `done`: finished points in words; `share`: the same [1];
        `modes`: number of finished points of each mode. While there is a store also `last_tile`: time of the last tile;
        `damaged`: path of the store if it is damaged; `at_work`: the process that holds its lock. Each is "" if there
        is none.

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
            return {"cube": str(out), "written": out.exists(), **_of_tiles(store)}
    if os.path.exists(out):
        modes = count_modes(out)
        done = f"complete, {sum(modes.values())} points"
        return {"cube": str(out), "written": True, "done": done, "share": 1.0, "modes": modes}
    raise StoreError(f"{out}: no such cube, and no sweep for it (there is no {tiles_of(out)})")


def _of_tiles(store: Store) -> dict[str, Any]:
    """Return the items of `status` that are read from a store of tiles."""
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
    words = f"{words_for(store, done)} done ({100 * done // wanted} %)"
    damaged = str(store.path) if unreadable or store.is_cut else ""
    state = {"done": words, "share": done / wanted, "modes": dict(tally.most_common())}
    return state | {"last_tile": last, "damaged": damaged, "at_work": holder(store.path) or ""}


def status_lines(state: dict[str, Any]) -> list[str]:
    """Return a status, as `status` gives it, in lines of text."""
    lines, modes = [f"{state['cube']}: {state['done']}"], state["modes"]
    if modes:
        lines.append("modes: " + ", ".join(f"{mode} {count}" for mode, count in modes.items()))
    if "at_work" not in state:
        return lines
    if state["last_tile"]:
        lines.append(f"last tile: {_ago(state['last_tile'])}")
    lines.append(f"failed: {modes.get('failed', 0)} points")
    if state["damaged"]:
        lines.append(f"{state['damaged']}: is damaged; what is lost will be computed again")
    if state["share"] == 1 and not state["at_work"]:
        lines.append(
            "cube: is written" if state["written"] else "cube: is still to be written; run the same sweep again"
        )
    else:
        lines.append(f"at work: {state['at_work'] or 'nobody; run the same sweep again to go on'}")
    return lines


def _ago(time: str) -> str:
    """Return how long ago `time` (ISO 8601) was, in words; or say that it lies in the future."""
    seconds = (datetime.now(UTC) - datetime.fromisoformat(time)).total_seconds()
    return f"{clock(seconds)} ago" if seconds >= 0 else f"{time}, by a clock that has been set back since"
