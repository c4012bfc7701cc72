#!/usr/bin/env bash
# A program whose first uses of xarray are in two threads at once may not get its file, where dask is installed: xarray loads `dask`
# to make a variable, but `dask.base` to open a file with a coordinate. Python breaks the deadlock of their import locks with a module
# that is loaded by half: an ImportError (the other thread has one, too, and drops it). `import dask` before the threads begin
# helps. A hook keeps the first thread half-way through dask until the other one is there; without it this comes by chance.
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet dask==2026.8.0 xarray==2026.9.0 numpy==2.4.6 netCDF4==1.7.5.1.post1
cd "$place"
"$place/venv/bin/python" -c 'import xarray; xarray.Dataset({"a": ("x", [1.0, 2.0])}, {"x": [0.0, 1.0]}).to_netcdf("a.nc")'
cat >threads.py <<'PY'
import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from threading import Event, current_thread, main_thread

import xarray

half_way, begun = Event(), Event()


class HalfWay:
    def find_spec(self, name, path=None, target=None):
        if name == "dask.config":
            half_way.set()
            begun.wait(5)
        elif name == "dask.base" and current_thread() is not main_thread():
            begun.set()


def opened():
    half_way.wait(5)
    return xarray.open_dataset("a.nc").a.sum().item()


def tried(call):
    try:
        return call()
    except ImportError as error:
        return f"ImportError: {error}".partition(" (")[0]


for module in sys.argv[1:]:
    importlib.import_module(module)
sys.meta_path.insert(0, HalfWay())
with ThreadPoolExecutor() as threads:
    other = threads.submit(tried, opened)
    made = tried(lambda: xarray.Variable("x", [1.0, 2.0]).sum().item())
    half_way.set()
    print(f"dask {version('dask')}, xarray {version('xarray')}: made {made} | opened {other.result()}")
PY
"$place/venv/bin/python" threads.py | tee said.txt
grep -qF "opened ImportError: cannot import name 'annotate' from partially initialized module 'dask.base'" said.txt
"$place/venv/bin/python" threads.py dask | tee said.txt
grep -qF "made 3.0 | opened 3.0" said.txt
