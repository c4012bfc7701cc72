"""Borders declared in files: made, written, drawn, and refused with a line."""

import contextlib
import sqlite3
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgb

from dimersweep import names, orbits
from dimersweep.analysis.borders import border_files
from dimersweep.analysis.borders.border_files import kept_part, make_borders, parts_of, plan_borders, read_borders
from dimersweep.analysis.orbits.borders.pictures import SMOOTH, _smoothed, draw_borders
from dimersweep.cli import app
from dimersweep.errors import OrbitError, ParameterError, Stopped, StoreError
from dimersweep.kernel.model.layout import MODES
from dimersweep.storage.formats.format import as_made
from dimersweep.storage.store import Store, opened_store
from tests.checks.conform import conforms
from tests.checks.data import DATA

BORDERS = Path(__file__).parents[2] / "sweeps" / "borders"


@pytest.mark.parametrize("path", sorted(BORDERS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_declaration_is_allowed_and_has_a_small_preset(path):
    declared = read_borders(path)
    small = read_borders(path.with_name(path.stem.removesuffix("-small") + "-small.toml"))
    assert Path(declared.borders.output).suffix == ".nc"
    for part in ("curves", "branches", "families"):
        assert (getattr(declared, part) is None) == (getattr(small, part) is None)
    assert list(declared.over) == list(small.over)


@pytest.mark.slow
@pytest.mark.jit
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("atlas_f-small", marks=pytest.mark.release),
        "branch-small",
        "families-small",
        "fig14_16-small",
    ],
)
def test_a_small_preset_is_written_and_drawn(name, tmp_path, coarse_pictures):
    out = tmp_path / "borders.nc"
    made = make_borders(read_borders(BORDERS / f"{name}.toml"), out)
    with xr.open_dataset(out) as back:
        back.load()
        xr.testing.assert_identical(as_made(back), made)
        assert back.attrs["Conventions"] == "CF-1.11"
        assert back.attrs["configuration_sha256"]
        figure = draw_borders(back)
        figure.savefig(tmp_path / "figure.png")
        assert r"$\mu$ = 0.2, $\mu_s$ = 0.4" in figure.get_suptitle().replace("\xa0", " ")
        assert r"\beta(0)" not in figure.get_suptitle()
    with pytest.raises(StoreError, match="exists already"):
        make_borders(read_borders(BORDERS / f"{name}.toml"), out)
    assert not out.with_name("borders.nc.parts").exists()
    conforms(out)


CURVES, BRANCHES, FAMILIES = (
    (DATA / "borders" / f"{name}.toml").read_text() for name in ("curves", "branches", "families")
)


def declared_in(folder, text=FAMILIES):
    declaration = folder / "two.toml"
    declaration.write_text(text)
    return read_borders(declaration)


@pytest.mark.jit
def test_a_file_that_was_stopped_goes_on_from_its_finished_parts(tmp_path, monkeypatch):
    declared, out, parts = declared_in(tmp_path), tmp_path / "two.nc", tmp_path / "two.nc.parts"
    whole, asked = make_borders(declared), []

    def stopping(**given):
        asked.append(given["A_r"])
        if len(asked) == 2:
            raise KeyboardInterrupt
        return orbits.family(**given)

    def stopping_at_the_end(*rest, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(border_files, "family", stopping)
    assert plan_borders(declared, out) == ["families: 2 parts, 3 points each: family-0, family-1"]
    with pytest.raises(Stopped, match=f"1 of 2 parts are kept in {parts}"):
        make_borders(declared, out)
    assert not out.exists()
    assert plan_borders(declared, out)[1:] == ["there already: family-0"]
    with monkeypatch.context() as patch, pytest.raises(Stopped, match=f"2 of 2 parts are kept in {parts}; the same"):
        patch.setattr(border_files, "write_cube", stopping_at_the_end)
        make_borders(declared, out)
    lines = []
    resumed = make_borders(declared, out, tell=lines.append)
    assert asked == [5.5, 6.0, 6.0]
    assert lines[0] == "2 of 2 parts are there already: family-0, family-1"
    assert not parts.exists()
    xr.testing.assert_equal(resumed, whole)


@pytest.mark.jit
def test_parts_of_another_declaration_are_refused(tmp_path):
    declared, out = declared_in(tmp_path), tmp_path / "two.nc"
    with opened_store(Store, parts_of(out), declared.configuration | {"fixed": {"e": 0.5}}, 2):
        pass
    assert plan_borders(declared, out) == ["families: 2 parts, 3 points each: family-0, family-1"]
    with pytest.raises(StoreError, match=r"results of other settings.*What differs:\n  fixed.e: 0.5 -> nothing$"):
        make_borders(declared, out)
    make_borders(declared, out, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["two.nc", "two.toml"]


@pytest.mark.jit
def test_a_part_that_is_damaged_is_told_and_made_again(tmp_path, monkeypatch):
    declared, out, parts = declared_in(tmp_path), tmp_path / "two.nc", tmp_path / "two.nc.parts"
    whole, asked, makers = make_borders(declared), [], declared.parts()
    with opened_store(Store, parts, declared.configuration, len(makers)) as store:
        for place, (name, make) in enumerate(makers.items()):
            kept_part(store, place, name, partial(make, lambda line: None))
    with contextlib.closing(sqlite3.connect(parts)) as file, file:
        file.execute("UPDATE tiles SET results = substr(results, 1, 1000) WHERE what = 'family-1'")
    monkeypatch.setattr(border_files, "family", lambda **given: asked.append(given["A_r"]) or orbits.family(**given))
    told = r"two.nc.parts: damaged results are computed again \(tile 1 has other bytes than were written\)$"
    with pytest.warns(RuntimeWarning, match=told):
        again = make_borders(declared, out)
    assert asked == [6.0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["two.nc", "two.toml"]
    xr.testing.assert_equal(again, whole)


@pytest.mark.parametrize("kind", ["file", "folder", "link", "dangling link"])
def test_what_is_no_store_of_parts_is_refused_and_stays(tmp_path, kind):
    declared, parts, mine = declared_in(tmp_path), tmp_path / "two.nc.parts", tmp_path / "mine"
    mine.write_text("precious")
    if kind == "file":
        parts.write_text("precious")
    elif kind == "folder":
        parts.mkdir()
    else:
        parts.symlink_to(mine if kind == "link" else "nowhere")
    for force in (False, True):
        with pytest.raises(StoreError, match=r"two.nc.parts: .*, where what is finished is kept; move it, or"):
            make_borders(declared, tmp_path / "two.nc", force=force)
    assert mine.read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine", "two.nc.parts", "two.toml"]


@pytest.mark.jit
def test_a_file_that_fails_leaves_nothing_behind(tmp_path):
    with pytest.raises(OrbitError):
        make_borders(declared_in(tmp_path, FAMILIES + "[fixed]\nGamma = 0.1\n"), tmp_path / "none.nc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["two.toml"]


def test_a_branch_is_drawn_as_a_smooth_curve_through_its_points():
    turn = np.linspace(-1.0, 1.0, 7)
    at, x, y = _smoothed(turn**2, 5 + turn)
    np.testing.assert_allclose(x[::SMOOTH], turn**2)
    np.testing.assert_allclose(y[::SMOOTH], 5 + turn)
    assert at[SMOOTH] == 1 and x.min() == 0  # the fold stays where it is
    directions = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
    assert np.abs(np.diff(directions)).max() < 0.3
    corners = np.arctan2(np.diff(5 + turn), np.diff(turn**2))
    assert np.abs(np.diff(corners)).max() > 2 * 0.3


def test_families_tell_their_quantities_in_symbols_and_plain_numbers(tmp_path):
    spin, nothing = np.linspace(90, 150, 5), xr.DataArray(np.ones((1, 5)), dims=("over", "spin"))
    columns = dict.fromkeys(("radius", "period", "zeta", "spin_drift"), nothing * spin / 3)
    table = xr.Dataset(columns, {"spin": spin, "A_r": ("over", [6.0])}, {"title": "families", "what": "families"})
    figure = draw_borders(table)
    figure.savefig(tmp_path / "a.png")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert r"$\zeta$ [rad]" in labels and not any("zeta" in label.replace(r"\zeta", "") for label in labels)
    assert not [
        text for axes in figure.axes for text in axes.get_yticklabels(which="both") if "times" in text.get_text()
    ]
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    assert boxes[1].x0 - boxes[0].x1 > 5 and boxes[3].x0 - boxes[2].x1 > 5


@pytest.mark.jit
def test_curves_are_those_of_border(tmp_path, coarse_pictures):
    text = (BORDERS / "atlas-small.toml").read_text()
    text = text.replace(
        'kinds = ["stable_from", "stable_to", "fold", "flip", "hop"]', 'kinds = ["fold", "flip"]'
    ).replace("num = 7", "num = 3")
    made = make_borders(declared_in(tmp_path, text))
    direct = orbits.border("flip", "Gamma", over={"A_r": [6.0], "e": [0.5, 0.6, 0.7]}, spin=100.0)
    made = names(made).swap_dims(border="kind")
    assert made["Gamma"].sel(kind="flip").values == pytest.approx(direct["Gamma"].values, abs=1e-9)
    assert made["ball"].sel(kind="fold").values[0] == pytest.approx(np.pi * np.array([0.5, 0.4, 0.3]) / [1.5, 1.6, 1.7])
    modes = (("Gamma", "e"), np.full((2, 3), MODES.index("drift")), {"flag_values": range(len(MODES))})
    over = xr.Dataset({"mode": modes}, {"Gamma": [0.6, 0.9], "e": [0.5, 0.6, 0.7]})
    over["mode"].attrs["flag_meanings"] = " ".join(MODES)
    figure = draw_borders(made.swap_dims(kind="border"), over)
    figure.savefig(tmp_path / "figure.png")
    (region,) = [patch for patch in figure.legends[0].get_patches() if patch.get_label().startswith("drift")]
    (cells,) = figure.axes[0].collections
    assert to_rgb(region.get_facecolor()[:3]) == pytest.approx(to_rgb(cells.get_facecolor()[0][:3]))


@pytest.mark.jit
def test_the_command_makes_a_file_and_a_picture(tmp_path, capsys, coarse_pictures):
    out = tmp_path / "branch.nc"
    app(["borders", str(BORDERS / "branch-small.toml"), "--out", str(out)], standalone_mode=False)
    assert out.is_file()
    assert out.with_suffix(".png").is_file()
    assert "points" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["atlas.png", "out.txt"])
def test_a_table_has_the_ending_of_its_format(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    declaration = tmp_path / "two.toml"
    declaration.write_text(FAMILIES.replace("families.nc", name))
    with pytest.raises(ParameterError, match=rf"borders.output = {name}: a table must end in .nc$"):
        app(["borders", str(declaration)], standalone_mode=False)
    declaration.write_text(FAMILIES)
    with pytest.raises(ParameterError, match=rf"^out = {name}: a table must end in .nc$"):
        app(["borders", str(declaration), "--out", name], standalone_mode=False)
    with pytest.raises(ParameterError, match=rf"^out = {name}: a table must end in .nc$"):
        make_borders(read_borders(declaration), name)
    assert list(tmp_path.iterdir()) == [declaration]


def test_a_table_never_replaces_the_map_that_it_is_drawn_over(tmp_path):
    declaration, under = tmp_path / "two.toml", tmp_path / "map.nc"
    declaration.write_text(FAMILIES)
    under.write_text("precious")
    with pytest.raises(ParameterError, match=r"^out = .*map.nc: would replace what is read; give another name$"):
        app(["borders", str(declaration), "--over", str(under), "--out", str(under), "--force"], standalone_mode=False)
    assert under.read_text() == "precious"


def test_what_is_no_file_of_borders_is_refused_in_a_line(tmp_path):
    bad = tmp_path / "bad.toml"
    with pytest.raises(ParameterError, match="cannot be read"):
        read_borders(bad)
    for written, message in (
        (b"[[", "is no valid TOML"),
        (CURVES.encode() + b"# \xff", "is no text in UTF-8"),
        (CURVES.replace("[5, 6]", "[" * 5000 + "5" + "]" * 5000).encode(), "is nested too deeply"),
        (CURVES.replace("[5, 6]", "[" * 50 + "5" + "]" * 50).encode(), "must be a number"),
    ):
        bad.write_bytes(written)
        with pytest.raises(ParameterError, match=rf"^{bad}: .*{message}"):
            read_borders(bad)
    with pytest.raises(ParameterError, match="neither curves nor branches"):
        draw_borders(xr.Dataset())


@pytest.mark.jit
def test_xdot0_may_give_the_spin_of_branches_and_of_curves(tmp_path):
    for text in (CURVES, BRANCHES):
        given = text.replace("spin = 100", "").replace("[over]", "[fixed]\nxdot0 = 0.5\n[over]")
        assert declared_in(tmp_path, given).fixed == {"xdot0": 0.5}


@pytest.mark.jit
def test_words_of_all_parts_are_written_whole(tmp_path):
    """The status of the hop is longer than that of the fold before it."""
    out = tmp_path / "two.nc"
    text = (BORDERS / "atlas-small.toml").read_text()
    text = text.replace('["stable_from", "stable_to", "fold", "flip", "hop"]', '["fold", "hop", "stable_to"]')
    text = text.replace("start = 0.5, stop = 0.7, num = 7", "start = 0.65, stop = 0.7, num = 2")
    made = make_borders(declared_in(tmp_path, text), out)
    with xr.open_dataset(out) as back:
        assert back["status"].values.tolist() == made["status"].values.tolist()
        beyond = "several beyond, of motions that come to no rest"
        assert back["status"].values.ravel().tolist()[:4] == ["ok", "ok", "ok", beyond]
        ends = names(back).swap_dims(border="kind").sel(kind="stable_to")
        assert set(ends["ends_by"].values.ravel()) == {"flip"} and ends["loses_stability"].all()
