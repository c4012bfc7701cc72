"""A stand-in for the compiled kernel, for tests of what is around it."""

from contextlib import suppress

import numpy as np

from dimersweep.cubes.results import blank_results
from dimersweep.errors import StoreError
from dimersweep.kernel.batch import new_workspace
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.layout import CODES, DI_SP_SK, JAMMED, M_DRIFT, M_FAILED, M_JUMP, M_REST, OK, OUT, ROW
from dimersweep.storage.store import looked_at
from dimersweep.storage.tilestore import tile_store, tiles_of

SLOT = {name: k for k, name in enumerate(ROW)}
CODE = {name: k for k, name in enumerate(CODES)}


def fake_run_many(rows, periods, rtol, settle, out, codes, until=0, space=None):
    """Bands of drift in beta0 that get denser with f, an unresolved start, rest elsewhere."""
    beta0, f = rows[:, SLOT["beta0"]], rows[:, SLOT["f"]]
    drift = np.sin(2 * f * beta0) > 0.2
    codes[:, CODE["status"]] = OK
    codes[:, CODE["mode"]] = np.where(beta0 < 0.02, layout.M_UNRESOLVED, np.where(drift, M_DRIFT, M_REST))
    codes[:, CODE["mode_period"]] = 1
    codes[:, CODE["di_end"]] = np.where(drift, DI_SP_SK, 0)
    codes[:, CODE["n_events"]] = 30 * periods
    codes[:, CODE["n_periods"]] = periods
    out[:, OUT.index("radius")] = np.where(drift, f**2 / 50 + 1e-3 * beta0, np.nan)
    out[:, OUT.index("zeta")] = np.where(drift, 1.6, np.nan)
    stops = np.flatnonzero(until >> codes[:, CODE["mode"]] & 1)
    made = int(stops[0]) + 1 if stops.size else len(rows)
    out[made:], codes[made:] = np.nan, 0
    return made


def failing(chosen, run_many=fake_run_many):
    """A kernel that ends without a result, as the model may, at points that `chosen` picks from their rows."""

    def fails(rows, periods, rtol, settle, out, codes, until=0, space=None):
        run_many(rows, periods, rtol, settle, out, codes)
        failed = np.broadcast_to(chosen(rows), len(rows))
        out[failed], codes[failed] = np.nan, 0
        codes[failed, CODE["status"]], codes[failed, CODE["mode"]] = JAMMED, M_FAILED
        stops = np.flatnonzero(until >> codes[:, CODE["mode"]] & 1)
        made = int(stops[0]) + 1 if stops.size else len(rows)
        out[made:], codes[made:] = np.nan, 0
        return made

    return fails


def raising(chosen, run_many=fake_run_many):
    """A kernel that raises at points that `chosen` picks from their rows."""

    def raises(rows, *others, until=0, space=None):
        if np.any(chosen(rows)):
            raise MemoryError("no room")
        return run_many(rows, *others, until=until)

    return raises


def interrupts(*_, **__):
    """In place of anything that Ctrl-C stops."""
    raise KeyboardInterrupt


def points_made(made):
    """How many points these rows of calls are."""
    return sum(map(len, made))


def same_bits(cube, reference):
    """Whether a cube has the variables of another one to the bit, and no more."""
    told, expected = (
        {name: (each.dims, each.values.tobytes()) for name, each in one.items()} for one in (cube, reference)
    )
    return told == expected


def run_tile(spec, tile):
    """Results of the points of a tile in as few calls as can be, without any scheduling: what all else must give."""
    points, results, done = np.arange(*tile), blank_results(tile.stop - tile.start), 0
    while done < points.size:
        done += spec.advance(points[done:], results[done:], new_workspace())
    return results


def forget_some(out, configuration, kind, seed):
    """As if a search for `out`, whose store was kept, had been stopped: delete the cube and about half of the points."""
    rng = np.random.default_rng(seed)
    with looked_at(tiles_of(out)) as store:
        size = store.size
    done = points_on_disk(out)
    out.unlink()
    with tile_store(out, configuration, size, kind) as tiles:
        tiles.drop(lambda results: rng.random(len(results)) < 0.5)
    assert 0 < points_on_disk(out) < done


def points_on_disk(out):
    """Number of the finished points that are kept for a cube."""
    with suppress(StoreError), looked_at(tiles_of(out)) as store:
        return sum(row.stop - row.start for row in store.summaries())
    return 0


def banded_kernel(rows, periods, rtol, settle, out, codes, until=0, space=None):
    """Rest below a curve in (e, Gamma); then jumps, and in a part of the border some starts that drift."""
    e, Gamma, beta0 = rows[:, SLOT["e_1"]], rows[:, SLOT["Gamma"]], rows[:, SLOT["beta0"]]
    height = Gamma - (1.35 - e**2)
    drift = (e > 0.47) & (height > 0) & (height < 0.21) & (np.abs(beta0 - 0.3 - e / 2) < 0.1)
    codes[:, CODE["status"]] = OK
    codes[:, CODE["mode"]] = np.where(drift, M_DRIFT, np.where(height > 0.13, M_JUMP, M_REST))
    stops = np.flatnonzero(until >> codes[:, CODE["mode"]] & 1)
    made = int(stops[0]) + 1 if stops.size else len(rows)
    codes[made:] = 0
    return made
