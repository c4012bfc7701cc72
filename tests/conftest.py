"""Fixtures of the tests around the kernel, and what is said of tests that were left out."""

import gc
import os
import re
import signal
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings
from typer.main import get_command

from dimersweep import cli
from tests.browser import chromium
from tests.checks.small_cubes import make_small_cubes
from tests.fakes import fake_run_many
from tests.seams import rows_made, use_kernel

settings.register_profile("unhurried", deadline=None)  # a machine may be busy
settings.load_profile("unhurried")
# thousands of tests are kept: to look through them for garbage takes a twentieth of all processor time
gc.set_threshold(50_000, 20, 100)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts its background jobs with Ctrl-C ignored
command_of = cache(get_command)  # of the whole command line, which is otherwise put together anew at each call


@pytest.fixture
def fake_kernel(monkeypatch):
    """Run sweeps on `fake_run_many`."""
    use_kernel(monkeypatch, fake_run_many)


@pytest.fixture
def asked(monkeypatch):
    """Run sweeps on `fake_run_many`: the rows of the points that it makes, each call one item."""
    return rows_made(monkeypatch, fake_run_many)


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command line in this process; what it printed and its exit code."""

    monkeypatch.setattr("typer.main.get_command", command_of)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["dimersweep", *arguments])
        try:
            cli.main()
            code = 0
        except SystemExit as stop:
            code = stop.code
        printed = capsys.readouterr()
        return printed.out, printed.err, code

    return run


@pytest.fixture
def done(call):
    """Run a command that succeeds; what it printed."""

    def run(*arguments):
        out, err, code = call(*arguments)
        assert code == 0, err
        return out

    return run


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    """Work in an empty folder, which is given."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def coarse_pictures(monkeypatch):
    """Write pictures at which nobody looks: of few pixels, not laid out, and each heading in one line."""
    monkeypatch.setattr("dimersweep.plots.style.DPI", 40)
    monkeypatch.setattr("matplotlib.figure.Figure.get_layout_engine", lambda _: None)
    monkeypatch.setattr("matplotlib.text.Text.get_wrap", lambda _: False)


@pytest.fixture(scope="module")
def browser():
    """A Chromium for the tests of a module: its start takes a second of processor time."""
    with chromium() as launched:
        yield launched


@pytest.fixture(scope="session")
def small_cubes(tmp_path_factory):
    """The folder of the cubes of all small presets."""
    if os.environ.get("DIMERSWEEP_CUBES"):
        return Path(os.environ["DIMERSWEEP_CUBES"])
    folder = tmp_path_factory.mktemp("cubes")
    make_small_cubes(folder)
    return folder


LONG = {"test_cli", "test_datasets", "test_pictures", "test_reuse", "test_zarrs"}  # a minute, of many tests


def pytest_collection_modifyitems(items):
    """Begin with the files that hold a slow test or are long, so that no process is left alone with one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow") or item.path.stem in LONG}
    items.sort(key=lambda item: item.path not in slow)


# kinds of tests that need what a machine may lack, by the reasons that they give
LEFT_OUT = {"browser": r"in a browser", "slow": r"DIMERSWEEP_SLOW", "references": r"reference"}


def pytest_unconfigure(config):
    """Say at the very end which kinds of tests were left out, and why."""
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if reporter is None or not hasattr(reporter, "stats") or hasattr(config, "workerinput"):
        return
    reasons = [str(report.longrepr[2]).removeprefix("Skipped: ") for report in reporter.stats.get("skipped", [])]
    if reasons or reporter.stats.get("passed"):
        reporter.write_line(left_out(reasons))


def left_out(reasons):
    """The line on tests that were left out for these reasons."""
    kinds = Counter()
    for reason in reasons:
        kind = next((kind for kind, words in LEFT_OUT.items() if re.search(words, reason)), "other")
        kinds[kind, reason] += 1
    words = "; ".join(f"{count} {kind} ({reason})" for (kind, reason), count in sorted(kinds.items()))
    return f"tests left out: {words or 'none'}"
