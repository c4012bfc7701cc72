"""Write one file of each kind as this version writes them: ``python -m tests.checks.former tests/data/1.0``.

They stay as they are: `tests/test_former.py` reads them in all later versions. A minor version adds a folder of its own for a
kind that is new, or is written otherwise.
"""

import sys
from pathlib import Path

import pytest

from dimersweep import sweep
from dimersweep.errors import Stopped
from dimersweep.runs import solving
from tests.checks.kinds_of_files import KINDS, write
from tests.seams import set_pace, use_kernel

# what is not kept: a kind that differs from another one in its axes only, and a format of many files
LEFT_OUT = ("cube of three axes", "cube in Zarr")
STOPPED_SWEEP = {"grid": {"f": [15, 20], "beta0": [0.2, 0.3, 0.4, 0.5]}, "periods": 60}
STOPPED_AFTER = 2  # tasks
POINTS_OF_A_TASK = 2


def write_stopped_store(folder: Path) -> None:
    """Write the store of a sweep that was stopped after some tasks."""
    run_many, tasks = solving.run_many, []

    def stopping(*given, **more):
        tasks.append(given)
        if len(tasks) > STOPPED_AFTER:
            raise KeyboardInterrupt
        return run_many(*given, **more)

    with pytest.MonkeyPatch.context() as patch:
        set_pace(patch, POINTS_OF_A_TASK)
        use_kernel(patch, stopping)
        try:
            sweep(**STOPPED_SWEEP, out=folder / "stopped.nc", workers=1, progress=False)
        except Stopped:
            return
    raise AssertionError("the sweep was not stopped")


def main(folder: Path) -> None:
    """Write all of them into a folder."""
    for kind in KINDS:
        if kind not in LEFT_OUT:
            write(kind, folder)
    write_stopped_store(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
