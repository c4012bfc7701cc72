"""What decides whether a sweep goes on: all code that a number of a point passes, and no comment, docstring or layout."""

import ast
import io
import sys
import tokenize
from pathlib import Path

import pytest

import dimersweep
from dimersweep import refine, search, sweep
from dimersweep.extensions import ORBITS_CODE
from dimersweep.kernel import kernel_version
from dimersweep.kernel.compiler import versions
from dimersweep.studies.search import Search
from dimersweep.studies.study import Study
from dimersweep.studies.sweep import study_of
from tests.checks.kinds_of_files import heights

PACKAGE = Path(dimersweep.__file__).parent

EDITS = {  # of a small function: True for an edit of its code
    "a comment": ("# why", "# for another reason", False),
    "a comment that goes": ("  # why", "", False),
    "a comment of its own": ("    x = ", "    # first\n    x = ", False),
    "a docstring": ('"""Return', '"""Give back', False),
    "a docstring that goes": ('    """Return a # b: \\"\\"\\" of "it".\n\n    More.\n    """\n', "", False),
    "a line that is blank": ("    x = ", "\n    x = ", False),
    "a sign": ("-a", "+a", True),
    "a number": ("1.5", "1.6", True),
    "a text": ('"# no comment"', '"# another text"', True),
    "a long text": ("# no docstring", "# another text", True),
    "a level": ("    return", "        return", True),
    "a statement that is a comment now": ("    x = x", "    # x = x", True),
}
SMALL_FUNCTION = '''"""Compute."""

def function(a):  # why
    """Return a # b: \\"\\"\\" of "it".

    More.
    """
    x = {"b": -a, 'c': "# no comment", "d": """
# no docstring
"""}
    x = x if a else 1.5
    if x:
        a = 0
    return x
'''


@pytest.mark.parametrize("edit", EDITS)
def test_only_code_counts_in_the_version_of_results(edit):
    before, after, counts = EDITS[edit]
    assert before in SMALL_FUNCTION
    edited = SMALL_FUNCTION.replace(before, after)
    assert (versions.bare(edited.encode()) != versions.bare(SMALL_FUNCTION.encode())) == counts


def code_tokens(source):
    """Tokens of a source without comments and docstrings, by Python's own reading of it."""
    tree, docstrings = ast.parse(source), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            docstrings.add((node.body[0].lineno, node.body[0].col_offset))
    left_out, after_docstring = (tokenize.COMMENT, tokenize.NL, tokenize.INDENT, tokenize.DEDENT), False
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in left_out or after_docstring:
            after_docstring &= token.type != tokenize.NEWLINE
        elif token.start in docstrings:
            after_docstring = True
        else:
            yield token.string


def test_what_counts_of_each_module_is_its_code():
    for path, text in versions.take_sources().items():
        bare = versions.bare(text).decode().removeprefix(":").lstrip()
        # a body of a docstring alone is empty now, so that the rest is read by its tokens
        left = [
            each.string for each in tokenize.generate_tokens(io.StringIO(f"{bare}\n").readline) if each.string.strip()
        ]
        assert left == [each for each in code_tokens(text.decode()) if each.strip()], path


# modules that a point passes whose code cannot change its numbers: NaN and labels, checks of what is given, names to load
WITHOUT_NUMBERS = {"cubes/cube.py", "inputs.py", "extensions.py", "faces.py"}
QUIET = {"progress": False, "workers": 1}
BETA0 = {"beta0": [0.1, 0.3, 0.5]}
CIRCLING = {"A_r": 5, "f": 22, "e": 0.65, "mu": 0.1, "mu_s": 0.15}
STUDIES = {
    "points": lambda: sweep(points={"Gamma": [0.6], "e_1": [0.5]}, periods=20, **QUIET),
    "all of a point": lambda: sweep({"Gamma": [0.9]}, periods=30, max_periods=60, certify=True, strobes=2, **QUIET),
    "a line": lambda: sweep({"A_r": [5, 6]}, periods=20, carry="both", observe=heights, **QUIET),
    "a search": lambda: search(
        {"Gamma": [0.9, 1.2], **BETA0}, over="beta0", periods=60, orbit_periods=70, paths={"periods": 5}, **QUIET
    ),
    "a refined map": lambda: refine(
        {"Gamma": [0.6, 1.2], **BETA0}, over="beta0", halvings={"Gamma": 1}, periods=20, **QUIET
    ),
    "sustained spins": lambda: sweep({"Gamma": [0.9]}, CIRCLING, periods=20, sustained=True, **QUIET),
}


@pytest.mark.jit
@pytest.mark.parametrize("study", STUDIES)
def test_all_code_that_a_point_passes_is_in_the_version(study, monkeypatch):
    passed = set()

    def note(frame, event, _):
        passed.add(frame.f_code.co_filename)

    for kind in (Study, Search):
        advance = kind.advance

        def noted(*given, advance=advance):
            sys.setprofile(note)
            try:
                return advance(*given)
            finally:
                sys.setprofile(None)

        monkeypatch.setattr(kind, "advance", noted)
    STUDIES[study]()
    more = ORBITS_CODE if study == "sustained spins" else ()
    there = {path.relative_to(PACKAGE).as_posix() for path in map(Path, passed) if path.is_relative_to(PACKAGE)}
    assert {"parameters.py", "cubes/grid.py"} <= there
    assert not {path for path in there - WITHOUT_NUMBERS if not path.startswith((*versions.POINT_CODE, *more))}


def test_orbits_count_where_a_study_asks_for_them():
    plain, asked = (study_of({"Gamma": [0.9]}, periods=20, sustained=asked).configuration() for asked in (False, True))
    assert plain["kernel_version"] == kernel_version() != asked["kernel_version"] == kernel_version(*ORBITS_CODE)


@pytest.mark.jit
def test_a_run_behind_a_point_with_orbits_is_of_this_kernel(recwarn):
    cube = sweep({"Gamma": [0.9]}, CIRCLING, periods=20, sustained=True, **QUIET)
    assert cube.dimersweep.run().n_periods == 20
    assert not [each for each in recwarn if "another version of the kernel" in str(each.message)]
