"""Borders declared in files: made, written, drawn, and refused with a line."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from dimersweep import orbits
from dimersweep.cli import app
from dimersweep.errors import OrbitError, ParameterError, Stopped, StoreError
from dimersweep.orbits.pictures import draw_borders
from dimersweep.storage.provenance import as_text
from dimersweep.studies import border_files
from dimersweep.studies.border_files import make_borders, plan_borders, read_borders, storable
from dimersweep.studies.parts import parts_beside

BORDERS = Path(__file__).parents[1] / "sweeps" / "borders"


@pytest.mark.parametrize("path", sorted(BORDERS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_declaration_is_allowed_and_has_a_small_preset(path):
    declared = read_borders(path)
    small = read_borders(path.with_name(path.stem.removesuffix("-small") + "-small.toml"))
    assert Path(declared.borders.output).suffix == ".nc"
    for part in ("curves", "branches", "families"):
        assert (getattr(declared, part) is None) == (getattr(small, part) is None)
    assert list(declared.over) == list(small.over)


@pytest.mark.jit
@pytest.mark.parametrize("name", ["branch-small", "families-small", "fig14_16-small"])
def test_a_small_preset_is_written_and_drawn(name, tmp_path):
    out = tmp_path / "borders.nc"
    made = make_borders(read_borders(BORDERS / f"{name}.toml"), out)
    with xr.open_dataset(out) as back:
        back.load()
        xr.testing.assert_identical(back, made)
        assert back.attrs["Conventions"] == "CF-1.11"
        assert back.attrs["configuration_sha256"]
        draw_borders(back).savefig(tmp_path / "figure.png")
    with pytest.raises(StoreError, match="exists already"):
        make_borders(read_borders(BORDERS / f"{name}.toml"), out)
    assert not out.with_name("borders.nc.parts").exists()
    conforms(out)


def conforms(path):
    """Whether a file is CF, as its checker says."""
    checker = pytest.importorskip("compliance_checker.runner")
    checker.CheckSuite.load_all_available_checkers()
    report = path.with_suffix(".txt")
    passed, failed = checker.ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], 0, "strict", output_filename=str(report), output_format="text"
    )
    assert passed and not failed, report.read_text()


FAMILIES = """
[borders]
title = "Two short families"
output = "families.nc"
[families]
spin = [140, 150]
points = 3
[over]
A_r = [5.5, 6]
"""


@pytest.mark.jit
def test_a_file_that_was_stopped_goes_on_from_its_finished_parts(tmp_path, monkeypatch):
    declaration, out = tmp_path / "two.toml", tmp_path / "two.nc"
    declaration.write_text(FAMILIES)
    declared, parts = read_borders(declaration), tmp_path / "two.nc.parts"
    whole, asked = make_borders(declared), []

    def stopping(**given):
        asked.append(given["A_r"])
        if len(asked) == 2:
            raise KeyboardInterrupt
        return orbits.family(**given)

    monkeypatch.setattr(border_files, "family", stopping)
    assert plan_borders(declared, out) == ["families: 2 parts, 3 points each: family-0, family-1"]
    with pytest.raises(Stopped, match=f"1 of 2 parts are kept in {parts}"):
        make_borders(declared, out)
    assert not out.exists()
    assert plan_borders(declared, out)[1:] == ["there already: family-0"]
    lines = []
    resumed = make_borders(declared, out, tell=lines.append)
    assert asked == [5.5, 6.0, 6.0]
    assert lines[0] == "1 of 2 parts are there already: family-0"
    assert not parts.exists()
    xr.testing.assert_equal(resumed, whole)


@pytest.mark.jit
def test_parts_of_another_declaration_are_refused_and_a_file_of_the_user_stays(tmp_path):
    declaration, out, parts = tmp_path / "two.toml", tmp_path / "two.nc", tmp_path / "two.nc.parts"
    declaration.write_text(FAMILIES)
    declared = read_borders(declaration)
    parts.mkdir()
    (parts / "configuration.json").write_text(as_text(declared.configuration | {"fixed": {"e": 0.5}}))
    for name in ("notes.txt", "measured.nc", "family-0.nc"):
        (parts / name).write_text("mine")
    with pytest.raises(StoreError, match=r"parts of another file.*What differs:\n  fixed.e: 0.5 -> nothing$"):
        make_borders(declared, out)
    make_borders(declared, out, force=True)
    assert out.is_file()
    assert sorted(path.name for path in parts.iterdir()) == ["family-0.nc", "measured.nc", "notes.txt"]
    (parts / "part-family-0.nc").write_text("whose?")
    with pytest.raises(StoreError, match=r"holds part-\*\.nc without a configuration\.json, which tells what they are"):
        make_borders(declared, tmp_path / "two.nc", force=True)
    assert (parts / "part-family-0.nc").read_text() == "whose?"


@pytest.mark.jit
@pytest.mark.parametrize("damage", ["cut", "of another declaration"])
def test_a_part_that_is_damaged_is_told_and_made_again(tmp_path, monkeypatch, damage):
    declaration, out, parts = tmp_path / "two.toml", tmp_path / "two.nc", tmp_path / "two.nc.parts"
    declaration.write_text(FAMILIES)
    declared = read_borders(declaration)
    whole, asked = make_borders(declared), []
    with parts_beside(out, declared.configuration) as kept:
        for name, make in declared.parts().items():
            kept.take(name, lambda make=make: storable(make(lambda line: None)))
    part = parts / "part-family-1.nc"
    if damage == "cut":
        part.write_bytes(part.read_bytes()[:-1000])
        told = "is no NetCDF file, or a damaged one"
    else:
        with netCDF4.Dataset(part, "a") as file:
            file.configuration = "{}"
        told = "is of another configuration"
    monkeypatch.setattr(border_files, "family", lambda **given: asked.append(given["A_r"]) or orbits.family(**given))
    with pytest.warns(RuntimeWarning, match=rf"part-family-1.nc: {told}.*; it is made again$"):
        again = make_borders(declared, out)
    assert asked == [6.0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["two.nc", "two.toml"]
    xr.testing.assert_equal(again, whole)


@pytest.mark.parametrize("kind", ["file", "link", "dangling link"])
def test_what_is_no_folder_of_parts_is_refused_and_stays(tmp_path, kind):
    declaration, parts, mine = tmp_path / "two.toml", tmp_path / "two.nc.parts", tmp_path / "mine"
    declaration.write_text(FAMILIES)
    if kind == "file":
        parts.write_text("precious")
    else:
        parts.symlink_to(mine if kind == "link" else "nowhere")
    mine.mkdir()
    for force in (False, True):
        with pytest.raises(
            StoreError, match=r"two.nc.parts: is no folder, where what is finished is kept; move it, or"
        ):
            make_borders(read_borders(declaration), tmp_path / "two.nc", force=force)
    assert list(mine.iterdir()) == []
    assert not (tmp_path / "nowhere").exists()


def test_a_lock_among_the_parts_that_is_a_link_is_refused_in_a_line(tmp_path):
    declaration, parts = tmp_path / "two.toml", tmp_path / "two.nc.parts"
    declaration.write_text(FAMILIES)
    parts.mkdir()
    (tmp_path / "mine").write_text("precious")
    (parts / "lock").symlink_to(tmp_path / "mine")
    with pytest.raises(
        StoreError, match=r"^[^\n]*two.nc.parts: could not be written \(Too many levels of symbolic links\)"
    ):
        make_borders(read_borders(declaration), tmp_path / "two.nc")
    assert (tmp_path / "mine").read_text() == "precious"


@pytest.mark.jit
def test_a_file_that_fails_leaves_nothing_behind(tmp_path):
    declaration, out = tmp_path / "none.toml", tmp_path / "none.nc"
    declaration.write_text(FAMILIES + "[fixed]\nGamma = 0.1\n")
    with pytest.raises(OrbitError):
        make_borders(read_borders(declaration), out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["none.toml"]


@pytest.mark.jit
def test_curves_are_those_of_border(tmp_path):
    text = (BORDERS / "atlas-small.toml").read_text()
    text = text.replace('kinds = ["fold", "flip", "hop"]', 'kinds = ["fold", "flip"]').replace("num = 7", "num = 3")
    declaration = tmp_path / "atlas.toml"
    declaration.write_text(text)
    made = make_borders(read_borders(declaration))
    direct = orbits.border("flip", "Gamma", over={"A_r": [6.0], "e": [0.5, 0.6, 0.7]}, spin=100.0)
    made = made.swap_dims(border="kind")
    assert made["Gamma"].sel(kind="flip").values == pytest.approx(direct["Gamma"].values, abs=1e-9)
    assert made["ball"].sel(kind="fold").values[0] == pytest.approx(np.pi * np.array([0.5, 0.4, 0.3]) / [1.5, 1.6, 1.7])
    draw_borders(made.swap_dims(kind="border")).savefig(tmp_path / "figure.png")


@pytest.mark.jit
def test_the_command_makes_a_file_and_a_picture(tmp_path, capsys):
    out = tmp_path / "branch.nc"
    app(["borders", str(BORDERS / "branch-small.toml"), "--out", str(out)], standalone_mode=False)
    assert out.is_file()
    assert out.with_suffix(".png").is_file()
    assert "points" in capsys.readouterr().out


def test_what_is_not_allowed_is_told(tmp_path):
    bad = tmp_path / "bad.toml"
    for text, message in (
        ("", "Field required"),
        ('[borders]\ntitle = "a"\noutput = "b.nc"\n', "must have one of"),
        ('[borders]\ntitle = "a"\noutput = "b.nc"\n[curves]\nkinds = ["kink"]\n', "kink: unknown border"),
        ('[borders]\ntitle = "a"\noutput = "b.nc"\n[curves]\nkinds = ["fold"]\ncolor = 1\n', "Extra inputs"),
        ('[borders]\ntitle = "a"\noutput = "b.nc"\n[families]\nspin = [1, 2]\n[fixed]\nx = 1\n', "unknown parameter"),
        ("[[", "no TOML"),
    ):
        bad.write_text(text)
        with pytest.raises(ParameterError, match=message):
            read_borders(bad)
    with pytest.raises(ParameterError, match="cannot be read"):
        read_borders(tmp_path / "none.toml")
    with pytest.raises(ParameterError, match="neither curves nor branches"):
        draw_borders(xr.Dataset())
