#!/usr/bin/env bash
# From a fresh machine with Python 3.11 or later to a result in one command:
#   ./go fig07 [options]   make fig07.nc and fig07.png
#   ./go test              run every check and test
# Both set up a virtual environment first (.venv, or the folder that DIMERSWEEP_VENV names).
set -euo pipefail
cd "$(dirname "$0")"
venv=${DIMERSWEEP_VENV:-.venv}

find_python() {
    for python in python3 python3.13 python3.12 python3.11 python; do
        if "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$python"
            return
        fi
    done
    echo "go: error: no Python 3.11 or later was found on PATH" >&2
    return 1
}

# install what $1 names, unless that was done since pyproject.toml last changed
set_up() {
    local python stamp="$venv/installed-${1//[^a-z]/}"
    if [ ! -x "$venv/bin/python" ]; then
        python=$(find_python)
        "$python" -m venv "$venv"
    fi
    if [ pyproject.toml -nt "$stamp" ]; then
        echo "go: installing into $venv (about a minute)" >&2
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --editable "$1"
        touch "$stamp"
    fi
    PATH="$(cd "$venv/bin" && pwd):$PATH"
}

step() {
    echo "--- $*"
    "$@"
}

run_checks() {
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    step ruff check
    step ruff format --check
    step mypy
    step lint-imports --no-logo
    # the next two leave compiled kernels in the cache for the tests
    step dimersweep simulate --plot "$scratch/run.png"
    for sweep in sweeps/*-small.toml; do
        name=$(basename "$sweep" .toml)
        step dimersweep run "$sweep" --out "$scratch/$name.nc"
        step compliance-checker -t cf:1.11 "$scratch/$name.nc"
    done
    step env NUMBA_DISABLE_JIT=1 pytest -q -m "not jit" tests/kernel
    if compgen -G "notebooks/*.ipynb" >/dev/null; then
        step env DIMERSWEEP_CUBES="$scratch" pytest -q --nbmake notebooks
    fi
    step pytest -q
}

case "${1:-}" in
fig07)
    set_up .
    dimersweep run sweeps/fig07.toml "${@:2}"
    ;;
test)
    set_up ".[dev]"
    run_checks
    ;;
*)
    sed -n '2,5s/^# //p' "$0" >&2
    exit 2
    ;;
esac
