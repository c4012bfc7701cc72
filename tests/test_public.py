"""What people build on stays: public names and signatures, options, and what stands in files; and the stub says the same."""

import ast
from pathlib import Path

import dimersweep
from tests.checks.public import listing

LISTED = Path(__file__).parent / "data" / "public.txt"


def test_nothing_public_has_changed_unnoticed():
    listed, found = LISTED.read_text(encoding="utf-8").splitlines(), listing().splitlines()
    gone, new = [line for line in listed if line not in found], [line for line in found if line not in listed]
    assert not gone, "retire a name over a minor version (CONTRIBUTING.md), then list anew"
    assert not new, "python -m tests.checks.public > tests/data/public.txt"


def test_the_stub_names_what_the_package_gives():
    stub = ast.parse(Path(dimersweep.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    named = {name.asname: name.name for node in stub.body if isinstance(node, ast.ImportFrom) for name in node.names}
    assert {name for name in named if name} == {*dimersweep.__all__} - {"stability"}
    for name in dimersweep.__all__:
        value = getattr(dimersweep, name)
        where = getattr(value, "__module__", None) or value.__name__
        assert where.startswith("dimersweep"), name
