#!/usr/bin/env bash
# From a fresh machine with Python 3.11 or later to a result in one command:
#   ./go fig07 [options]   make fig07.nc and fig07.png
#   ./go test              run the checks and tests that are asked of a change
#   ./go test engine       run the tests of the engine alone, or of the analysis (./go test analysis)
#   ./go docs              build the site: build/docs/index.html
#   ./go release           run all checks and tests: all notebooks, the whole site, every target and both ways to compile
#   ./go matrix [options]  try versions, ways to compile and places (--small: two minutes)
# Each sets up a virtual environment first (.venv, or the folder that DIMERSWEEP_VENV names).
set -euo pipefail
cd "$(dirname "$0")"
unset PYTHONDONTWRITEBYTECODE # hundreds of processes import the same sources, which one compiles for all
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
        echo "go: installing into $venv (half a minute)" >&2
        # what is imported is compiled then, which is a fourth of it
        local pip=("$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile)
        # uv takes a third of pip's time, but does not read pip's settings
        if ! { "${pip[@]}" --only-binary uv uv &&
            "$venv/bin/uv" pip install --quiet --python "$venv/bin/python" --editable "$1"; }; then
            echo "go: uv cannot install it here; pip tries" >&2
            "${pip[@]}" --editable "$1"
        fi
        touch "$stamp"
    fi
    PATH="$(cd "$venv/bin" && pwd):$PATH"
}

step() {
    echo "--- $*"
    "$@"
}

# run a step beside those that follow; `finish` waits for it, prints what it said, and fails where it failed
begin() {
    set -m # a process group of its own, which can be ended whole
    step "$@" >"$scratch/$1.log" 2>&1 &
    set +m
    printf -v "$1" %s "$!"
}

finish() {
    local status=0
    wait "${!1}" || status=$?
    cat "$scratch/$1.log"
    return $status
}

make_scratch() {
    scratch=$(mktemp -d)
    trap 'for job in $(jobs -p); do kill -- "-$job" || :; done 2>/dev/null; rm -rf "$scratch"' EXIT
}

# run a command with what an extra asks for and nothing else of what is installed, as `./go fig07` and `./go docs` do
with_extra() {
    local folder="$scratch/with-$1"
    [ -d "$folder" ] || python -m tests.checks.alone "$folder" "$1"
    PATH="$folder/bin:$PATH" "${@:2}"
}

# the cubes of the small presets, where tests look for them
make_small_cubes() {
    export DIMERSWEEP_CUBES=$scratch
    step "$@" python -m tests.checks.small_cubes "$scratch"
}

# $1: which of the kernel's tests are run without the JIT
check_sources() {
    step ruff check
    step ruff format --check
    step mypy
    step lint-imports --no-logo
    step env NUMBA_DISABLE_JIT=1 pytest -q -m "$1" tests/kernel
}

build_site() {
    local begun=$SECONDS
    rm -rf docs/generated # pages of names that are gone would be orphans
    step "$@" python -m sphinx -W --keep-going --fresh-env ${quiet:-} docs build/docs
    echo "site: build/docs/index.html, in $((SECONDS - begun)) s"
}

# its pages, links and docstrings, without running the cells or writing a page
check_site() {
    rm -rf docs/generated
    step "$@" python -m sphinx -b dummy -W --keep-going --fresh-env --quiet -D nb_execution_mode=off \
        -D suppress_warnings=myst-nb.lexer docs "$scratch/site"
}

# threads of the linear algebra would wait for one another over small matrices, for a third of some tests' processor time
run_tests() {
    step env OPENBLAS_NUM_THREADS=1 pytest -q -n 4 --dist loadfile --no-loadscope-reorder --durations=25 "$@"
}

# two processors: what needs one of them goes beside the rest; where tests wait, a third and a fourth go on
run_checks() {
    make_scratch
    local failed=0 site="$1" quiet=--quiet # its pages in a log would be many lines
    begin check_sources "$2"
    make_small_cubes with_extra "" # this leaves compiled kernels in the cache for all that follows
    begin run_tests "${@:3}"
    begin "$site" with_extra docs
    for each in check_sources "$site" run_tests; do
        finish "$each" || failed=$?
    done
    return "$failed"
}

case "${1:-}" in
fig07)
    set_up .
    dimersweep run sweeps/fig07.toml "${@:2}"
    ;;
test)
    set_up ".[dev]"
    case "${2:-}" in
    engine) run_tests -m "not release" --ignore tests/analysis "${@:3}" ;;
    analysis) run_tests -m "not release" tests/analysis "${@:3}" ;;
    "")
        run_checks check_site "not jit and not release and not long_uncompiled and not inner_case" -m "not release"
        echo "what is asked before a release was left out: ./go release"
        ;;
    *)
        echo "go: error: test $2: must be engine, analysis or nothing" >&2
        exit 2
        ;;
    esac
    ;;
release)
    set_up ".[dev]"
    run_checks build_site "not jit" --timeout 6000 # a whole kernel is compiled the plain way, in minutes on a busy machine
    ;;
docs)
    set_up ".[docs]"
    echo "building the site, in a few minutes: Sphinx names each page that it reads, runs and writes"
    build_site
    ;;
matrix)
    set_up ".[dev]"
    python benchmarks/evidence/matrix.py "${@:2}"
    ;;
*)
    sed -n '2,9s/^# //p' "$0" >&2
    exit 2
    ;;
esac
