"""The known scenes with which a process begins: the kernel of these sources gives their numbers."""

import warnings

import numpy as np

from dimersweep.kernel.model.layout import CODES, MODES, OUT
from dimersweep.work.proving import CLOSE, SCENES, outcomes, proof


def test_the_known_scenes_warn_of_nothing():
    """A change of any number of theirs by more than 1e-4 of itself, also on purpose, has to be written there."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        proof.__wrapped__()


def test_each_number_of_a_known_scene_is_compared():
    out, codes = outcomes()
    for scene, numbers, code in zip(SCENES, out, codes, strict=True):
        assert MODES[code[CODES.index("mode")]] == scene.mode
        for name, known in scene.numbers.items():
            np.testing.assert_allclose(numbers[OUT.index(name)], known, rtol=CLOSE)
    assert CLOSE <= 1e-4
