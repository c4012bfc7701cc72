"""Siconos, an outside judge: its impacts and its planar run are the engine's; without it, one line says so."""

import sys
from itertools import product

import judge
import numpy as np
import pytest

STEP = 1e-4


@pytest.fixture(scope="module")
def siconos(tmp_path_factory):
    try:
        return judge.Siconos(tmp_path_factory.mktemp("siconos"))
    except FileNotFoundError as missing:
        pytest.skip(str(missing))


@pytest.mark.slow
@pytest.mark.jit
@pytest.mark.parametrize(("eta", "ratio"), list(product(judge.ETAS, judge.RATIOS)))
def test_impacts_at_two_contacts(siconos, eta, ratio):
    """Its error is in proportion to its step of impulse."""
    row = judge.row_of_balls(eta, ratio)
    np.testing.assert_allclose(row.by_siconos(siconos, STEP)[0], row.directly(), rtol=0, atol=judge.ALLOWED * STEP)
    for rates in judge.LANDINGS:
        landing = judge.Landing(judge.UNLIKE | {"eta": eta, "k_ratio": ratio}, rates)
        found, engine = landing.impact.by_siconos(siconos, STEP)[0], landing.by_engine(1e-10)
        np.testing.assert_allclose(found, engine, rtol=0, atol=judge.ALLOWED * STEP)
        np.testing.assert_allclose(landing.impact.directly(), engine, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.jit
def test_a_planar_run(siconos):
    """Shorter steps bring it nearer to the engine's; with them, the base case ends in its first chatter."""
    run = judge.Run(judge.RUNS["strong forcing, unlike ends"])
    expected = run.by_engine(1e-10)
    impacts, coarse, _, _ = run.by_siconos(siconos, 1e-3)
    _, fine, taken, stopped = run.by_siconos(siconos, 1e-5)
    apart = [np.abs((states - expected) / judge.SCALE[judge.PLANAR]).max() for states in (coarse, fine)]
    assert apart[1] < min(5e-3, 0.1 * apart[0])
    assert (len(impacts), stopped) == (4, "")
    assert taken > 0
    base = judge.Run(judge.RUNS["base case without friction"])
    impacts, states, _, stopped = base.by_siconos(siconos, 1e-6)
    assert "must be positive" in stopped
    assert 0.5 < impacts[-1] * base.scene["f"] < 0.65
    np.testing.assert_allclose(
        states / judge.SCALE[judge.PLANAR], base.by_engine(1e-10)[:4] / judge.SCALE[judge.PLANAR], atol=1e-3
    )


def test_without_siconos_one_line_says_so(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys, "argv", ["judge.py", "--prefix", str(tmp_path)])
    assert judge.main() == 0
    assert capsys.readouterr().out == f"left out: siconos is not installed ({judge.INSTALL})\n"
