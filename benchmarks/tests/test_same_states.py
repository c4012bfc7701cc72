"""What `same_states` concludes follows from what it measures."""

import numpy as np
import pytest
import same_states

pytestmark = pytest.mark.jit


def test_a_tree_beside_itself_differs_in_nothing_and_beside_another_answer_in_its_scale(monkeypatch, capsys):
    answers, modes = same_states.answer(3, 1e-8), np.array([1, 2, 2])
    monkeypatch.setattr(same_states, "answers_of", lambda *_: (answers, modes))
    assert same_states.main(["one", "other", "--runs", "3"]) == 0
    assert "0 statuses differ" in capsys.readouterr().out
    (status, state), *rest = answers
    moved = [(status, state | {"x1": state["x1"] + 1e-6}), *rest]
    np.testing.assert_allclose(same_states.apart(state, moved[0][1]), 1e-4, rtol=1e-6)  # 1 um in units of 1 cm
    others = ((moved, modes), ([("failed", state), *rest], modes), (answers, np.array([1, 2, 3])))
    for other in others:
        both = iter(((answers, modes), other))
        monkeypatch.setattr(same_states, "answers_of", lambda *_, both=both: next(both))
        assert same_states.main(["one", "other", "--runs", "3"]) == 1
