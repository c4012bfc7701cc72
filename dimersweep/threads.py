"""Work on several threads, for tasks that spend their time in compiled code: dask owns the cores, the caller the results."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import dask
from dask.callbacks import Callback

Item = TypeVar("Item")
Result = TypeVar("Result")


def run_each(
    task: Callable[[Item], Result], items: Iterable[Item], workers: int, take: Callable[[Result], None]
) -> None:
    """Call `task` with each of `items` on `workers` threads and hand each result to `take`, in the calling thread."""

    def posttask(key: Any, result: Any, dsk: Any, state: Any, worker: Any) -> None:
        take(result)

    each = dask.delayed(task, name="task", pure=False)
    with Callback(posttask=posttask):
        dask.compute([each(item) for item in items], scheduler="threads", num_workers=workers)
