"""The survey of random scenes counts what each scene gives; a failing scene is made simple."""

import numpy as np
import stress
from stress import minimise, survey

from tests.checks.random_scenes import rows_of, run_block


def test_the_survey_has_the_scenes_of_every_block():
    codes, nans, seconds, _, _ = survey(stress.BLOCK + 20, 7, "near", 2, 1e-8, 2)
    for block, here in enumerate((slice(0, 5), slice(stress.BLOCK, stress.BLOCK + 5))):
        expected, _, _, _ = run_block(rows_of(block, 5, 7, "near"), 2, 1e-8)
        np.testing.assert_array_equal(codes[here], expected)
    assert len(codes) == stress.BLOCK + 20
    assert not nans.any() and (seconds > 0).all()


def test_a_scene_is_made_simple_while_there_is_time(monkeypatch):
    """Fewest periods, base values, fewest decimals; and nothing at all where no time is left."""
    scene = {"Gamma": 19.131, "xdot0": 3.614}
    monkeypatch.setattr(stress, "faults", lambda trial, *_, **__: ["odd"] * (trial["Gamma"] > 15.0))
    assert minimise(scene, 7, 1e-8, "odd") == ({"Gamma": 20.0}, 1)
    monkeypatch.setattr(stress, "PATIENCE", 0.0)
    assert minimise(scene, 7, 1e-8, "odd") == (scene, 7)
