"""Make the slow oracle and the kernel's verbs importable."""

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
for folder in (TESTS / "kernel", TESTS):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
