"""The Python of the README runs as it stands, block after block, and so do its commands."""

import re
import shlex
import shutil
import sys
from pathlib import Path

from dimersweep import cli

README = Path(__file__).parents[1] / "README.md"


def test_the_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 3
    names = {}
    for block in blocks:
        exec(compile(block, str(README), "exec"), names)
    assert capsys.readouterr().out.startswith("drift ")
    assert (tmp_path / "cube.nc").exists()


def test_the_commands_run(tmp_path, monkeypatch, fake_kernel, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(README.parent / "sweeps", "sweeps")
    blocks = re.findall(r"```bash\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("dimersweep ")]
    lines.sort(key=lambda line: "run sweeps/fig07.toml" not in line or "--extend" in line)  # which others start from
    assert len(lines) >= 6
    for line in lines:
        monkeypatch.setattr(sys, "argv", shlex.split(line, comments=True))
        cli.main()
    assert "fig07.nc: complete, 13497 points" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} >= {"fig07.nc", "same.nc", "finer.nc", "again.png"}
