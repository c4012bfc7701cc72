"""Code that is made for different processors gives the same bits: a cluster may mix them, and a sweep goes on on any."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dimersweep
from dimersweep.kernel import kernel_version
from dimersweep.kernel.compiler import versions
from dimersweep.storage.cubefiles import open_cube
from dimersweep.studies.declared import read_declaration
from dimersweep.work.proving import is_proven
from tests.sweeper import GRID, SETTINGS

ROOT = Path(__file__).parents[1]
# friction-small runs the code of sustained-small, in a quarter of a minute
PRESETS = sorted({*(ROOT / "sweeps").glob("*-small.toml")} - {ROOT / "sweeps" / "friction-small.toml"})
AVX512 = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
TARGETS = {  # and what their code may use beyond the instructions of all
    "haswell": set(),
    "znver3": {"sse4a", "clwb", "sha_ni", "vaes"},
    "skylake-avx512": AVX512,
    "sapphirerapids": AVX512 | {"avx512vbmi", "avx512_bf16", "avx512_vnni", "avx512_bitalg", "avx512_vpopcntdq"},
    "x86-64-v3": set(),
}
pytestmark = [pytest.mark.jit, pytest.mark.slow, pytest.mark.release]


def has(flags):
    """Whether this processor runs code with all these instructions, those that all targets have, and more."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        return False
    lines = cpuinfo.read_text().splitlines()
    told = next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())
    return flags | {"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"} <= told


QUICK = "skylake-avx512" if has(AVX512) else "haswell"  # beside the default, x86-64-v3


def runnable(name):
    """A target that is left out where its code cannot run, or where there is time for the `QUICK` one only."""
    none, slow = not has(TARGETS[name]), name != QUICK and not os.environ.get("DIMERSWEEP_SLOW")
    reason = f"no {name} code runs here" if none else "half a minute each: set DIMERSWEEP_SLOW=1"
    return pytest.param(name, marks=pytest.mark.skipif(none or slow, reason=reason))


needs_fma = pytest.mark.skipif(not has(set()), reason="this processor has no fused multiply-add of x86-64")


def settings(name):
    """Environment of a process whose code is made for a processor; of this one, as by default, where it is None."""
    asked = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""} if name else {}
    without = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_CPU_")}
    return without | asked | {"PYTHONPATH": str(ROOT)}


def printed(name, *arguments):
    """What a process prints whose code is made for a processor."""
    made = subprocess.run([sys.executable, *arguments], env=settings(name), capture_output=True, text=True, check=True)
    return made.stdout


@pytest.mark.parametrize("name", [runnable(name) for name in TARGETS])
def test_small_presets_under_five_targets(name, small_cubes, tmp_path):
    """They have the bits of those that were made for the default one."""
    assert printed(name, __file__, tmp_path).split() == [name, kernel_version()]
    for path in PRESETS:
        cube, default = (open_cube(folder / f"{path.stem}.nc") for folder in (tmp_path, small_cubes))
        assert cube.variables.keys() == default.variables.keys()
        for variable in cube.variables:
            assert cube[variable].values.tobytes() == default[variable].values.tobytes(), (path, variable)
        assert cube.attrs["kernel_version"] == default.attrs["kernel_version"]


@needs_fma
def test_the_target_is_common_by_default_and_other_code_of_the_process_is_made_for_its_own():
    """The settings of Numba stay as they are, and so does what it makes of other functions."""
    code = (
        "import numba; import dimersweep.kernel.batch; from numba.core.registry import cpu_target; "
        "from dimersweep.kernel.compiler import versions; "
        "print(*versions.target(), numba.config.CPU_NAME, cpu_target.target_context.codegen()._tm.triple != '', "
        "cpu_target.target_context.codegen()._get_host_cpu_name())"
    )
    from llvmlite import binding

    assert printed(None, "-c", code).split() == [versions.COMMON, "None", "True", binding.get_host_cpu_name()]


@needs_fma
def test_workers_with_different_targets_finish_a_sweep(tmp_path):
    from distributed import Client, LocalCluster

    names = [QUICK, versions.COMMON]
    environment = [{"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""} for name in names]
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", env=environment[0]) as cluster:
        cluster.new_spec = cluster.new_spec | {"options": cluster.new_spec["options"] | {"env": environment[1]}}
        cluster.scale(2)
        with Client(cluster) as client:
            client.wait_for_workers(2, timeout=60)
            assert sorted(name for name, _ in client.run(versions.target).values()) == sorted(names)
            cube = dimersweep.sweep(GRID, **SETTINGS, progress=False, out=tmp_path / "cube.nc", client=client)
            assert list(client.run(is_proven).values()) == [True, True]  # both were given work
    alone = dimersweep.sweep(GRID, **SETTINGS, progress=False)
    for name, variable in alone.variables.items():
        np.testing.assert_array_equal(cube[name].values, variable.values, err_msg=str(name))
    assert cube.attrs["kernel_version"] == alone.attrs["kernel_version"]


if __name__ == "__main__":
    for preset in PRESETS:
        dimersweep.make(read_declaration(preset), Path(sys.argv[1]) / f"{preset.stem}.nc", progress=False)
    print(*versions.target(), kernel_version())
