"""`frozen` says of each answer whether it is as it was: of borders, of files, and of sweeps that were killed."""

import json

import frozen
import frozen_cases
import pytest
from frozen_cases import Case

pytestmark = pytest.mark.jit


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The fold of two dimers, a tiny cube and a sweep whose rest is refused, as they were."""
    tiny = frozen_cases.filed(
        "points", ".nc", lambda path: frozen_cases.SWEEPS["points"](out=path), frozen_cases.open_cube
    )
    begun = Case("half", lambda folder: {"mode": ["rest"]}, go_on=lambda folder: {"refused": "finish it with 0.1"})
    cases = {"borders": list(frozen_cases.borders(("fold",), 2)), "cubes": [tiny], "halves": [begun]}
    folder = tmp_path_factory.mktemp("frozen")
    frozen.make(folder, cases)
    frozen.make(folder, cases)  # what is there stays
    return folder, cases


def said(kept, capsys, explained=()):
    return frozen.compare(*kept, list(explained)), capsys.readouterr().out.splitlines()


def test_what_is_asked_twice_has_the_same_bits(kept, capsys):
    differ, lines = said(kept, capsys)
    assert (differ, lines) == (
        0,
        [
            "borders: 2 the same bits, 0 within 1e-6, 0 differ",
            "cubes: 2 the same bits, 0 within 1e-6, 0 differ",
            "halves, half: is refused: finish it with 0.1",
            "halves: 0 the same bits, 0 within 1e-6, 0 differ",
            "0 answers differ for no reason that is told",
        ],
    )


def test_a_difference_is_named_unless_its_reason_is_told(kept, capsys, monkeypatch):
    borders = frozen.answered(kept[0] / "borders.jsonl")
    near, far = borders.values()
    near["Gamma"] *= 1 + 1e-9
    far["Gamma"] *= 1 + 1e-3
    known = frozen.answered
    monkeypatch.setattr(frozen, "answered", lambda file: borders if file.stem == "borders" else known(file))
    differ, lines = said(kept, capsys)
    assert differ == 1
    assert lines[0].startswith("borders, dimer 1 fold: Gamma ") and lines[0].endswith("(1.0e-03)")
    assert lines[1] == "borders: 0 the same bits, 1 within 1e-6, 1 differ"
    differ, lines = said(kept, capsys, [("borders, dimer 1 *", "moved by hand")])
    assert differ == 0 and lines[0].endswith("[moved by hand]")


@pytest.mark.parametrize(
    ("was", "now", "verdict"),
    [
        ({"a": [1.0, float("nan")]}, {"a": [1.0, float("nan")]}, frozen.SAME),
        ({"a": 1.0}, {"a": 1.0 + 1e-9}, frozen.NEAR),
        ({"a": 0.0}, {"a": 1e-12}, frozen.NEAR),
        ({"a": 0.0}, {"a": 1e-6}, frozen.OTHER),
        ({"a": [1.0, float("nan")]}, {"a": [float("nan"), 1.0]}, frozen.OTHER),
        ({"a": {"b": "rest"}}, {"a": {"b": "drift"}}, frozen.OTHER),
        ({"a": 1}, {"a": 1, "b": 1}, frozen.OTHER),
        ({"a": [1.0]}, {"a": [1.0, 1.0]}, frozen.OTHER),
    ],
)
def test_numbers_are_compared_by_their_size(was, now, verdict):
    assert frozen.judged(json.loads(json.dumps(was)), now)[0] == verdict
