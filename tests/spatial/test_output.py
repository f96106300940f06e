"""Files of structures in space: ParaView, pictures, the viewer."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from fenics_contact.output.plotting import BLUE, FORCE, ORANGE
from fenics_contact.output.report.viewer import viewer_page, write_viewer
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.result import Collapse
from fenics_contact.results.words import mechanism_in_words
from fenics_contact.scene.scene import JointLaw, OutputOptions, SolveOptions, Tie
from fenics_contact.spatial import Load, Material, Scene, builders, limit_load
from fenics_contact.spatial.contacts import checked_contacts
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.picture import VIEWS, axes_to, draw_collapse, draw_view
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.structure import ContactLaw, Structure
from fenics_contact.spatial.ties import Bar
from fenics_contact.spatial.view import view_of, views_of
from fenics_contact.spatial.vtu import write_fields
from tests.vtu import values_of

GROUND = Block((Polyhedron.box([-3, -3, -0.2], [3, 3, 0]),), "ground", "ground", fixed=True)


def box(low, high, name="", group="default"):
    return Block((Polyhedron.box(low, high),), name, group)


def structure_of(blocks, friction, direction):
    """Blocks under their weight, pushed by a part of it."""
    blocks = (GROUND, *blocks)
    contacts = checked_contacts(blocks)[0]
    weight = np.array([0.0 if block.fixed else block.volume for block in blocks])
    dead = np.outer(weight, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    live = np.outer(weight, [*direction, 0.0, 0.0, 0.0])
    laws = (ContactLaw(friction),) * len(contacts)
    return Structure(blocks, contacts, laws, dead, live, quick=True)


TOWER = (
    box([-0.5, -0.5, 0], [0.5, 0.5, 1], "lower", "tower"),
    box([-0.5, -0.5, 1], [0.5, 0.5, 2], "upper", "tower"),
)


@pytest.fixture(scope="module")
def tipping():
    """A tower that turns about its edge at x = 0.5 under half its weight."""
    structure = structure_of(TOWER, 0.8, [1.0, 0.0, 0.0])
    return SpatialLimit(None, structure, {"positive": collapse_of(structure)})


@pytest.fixture(scope="module")
def sliding():
    structure = structure_of(TOWER, 0.3, [0.0, 1.0, 0.0])
    return SpatialLimit(None, structure, {"positive": collapse_of(structure)})


def test_contacts_know_what_they_do(tipping, sliding):
    view = view_of(tipping.structure, tipping.collapse)
    foot = [contact.first == 0 for contact in tipping.structure.contacts].index(True)
    states = list(view.contacts.state)
    assert states.pop(foot) == ContactState.ROCKS
    assert states == [ContactState.STICK]
    # The largest displacement is 8 % of the height; upright motion of the edge that lifts: a half.
    assert np.linalg.norm(view.displacement, axis=1).max() == pytest.approx(0.16)
    assert view.contacts.opening[foot] == pytest.approx(0.16 / 5**0.5, rel=1e-6)
    assert view.contacts.pressure[foot] == pytest.approx(2.0)
    assert view.contacts.utilisation[foot] == pytest.approx(0.5 / 0.8)
    slides = view_of(sliding.structure, sliding.collapse)
    assert ContactState.SLIP in slides.contacts.state
    assert slides.contacts.utilisation.max() == pytest.approx(1.0)


def test_what_slides_has_one_line(sliding):
    """At the foot of the block that has gone, in every view."""
    view = view_of(sliding.structure, sliding.collapse)
    for eye in VIEWS[3].values():
        turn = axes_to(eye)
        axes = Figure().subplots()
        draw_view(axes, view, turn)
        drawn = axes.collections[0]
        lines = [
            path.vertices[:2]
            for path, colour in zip(drawn.get_paths(), drawn.get_edgecolors(), strict=True)
            if to_hex(colour) == BLUE.lower()
        ]
        gone = view.bodies.corner[view.bodies.block == 1] + view.displacements(
            view.bodies.corner[view.bodies.block == 1], 1
        )
        foot = gone[np.isclose(gone[:, 2], 0.0)] @ turn[:2].T
        away = np.linalg.norm(np.vstack(lines)[:, None] - foot, axis=2).min(axis=1)
        assert np.allclose(away, 0.0, atol=1e-6)


def test_contacts_crush_at_their_strength(tipping):
    """Under uniform pressure p: at f_c = p, and not at 1.1 p."""
    count = len(tipping.structure.points.area)
    force = np.zeros((count, 3))
    force[:, 0] = 1.0  # at four corners of 1 m2: 4 Pa
    for strength, crushes in ((4.0, True), (4.4, False)):
        laws = (ContactLaw(0.5, compressive_strength=strength),) * 2
        structure = replace(tipping.structure, laws=laws)
        view = view_of(structure, Collapse("limit", 1.0, force=force))
        assert (ContactState.CRUSHES in view.contacts.state) == crushes


# ---- ParaView


def arrays(path):
    """Arrays of a VTU file by name."""
    found = {}
    for one in ElementTree.parse(path).iter("DataArray"):
        values = values_of(one)
        found[one.get("Name")] = values.reshape(len(values), -1)
    return found


def names(path, legend):
    """Names that a file has for numbers."""
    (one,) = ElementTree.parse(path).findall(f".//FieldData/DataArray[@Name='{legend}']")
    return [one.get(f"ComponentName{k}") for k in range(int(one.get("NumberOfComponents")))]


def tied_wall():
    """A block that a tie holds back, which is pushed to x."""
    tables = {
        "dimension": 3,
        "blocks": {"a": {"box": [[0, 0, 0], [1, 1, 2]]}},
        "materials": {"default": {"density": 1000.0}},
        "joints": {"default": {"friction": 0.8}},
        "loads": {
            "dead": {"body": [0.0, 0.0, -10.0]},
            "live": {"body": [10.0, 0.0, 0.0]},
        },
        "floors": {"<top>": {"z": 2.0, "force": 500.0}},
        "ties": {'"stay"': {"from": [0.5, 0.5, 1.5], "ground": [-1.0, 0.5, 1.5], "yield": 2000.0}},
    }
    return limit_load(Scene.from_tables(tables, Path()))


def test_paraview_has_ties_and_loads(tmp_path):
    """Ties are lines with their force, loads are points with their forces."""
    result = tied_wall()
    write_fields(result, tmp_path)
    ties = arrays(tmp_path / "ties.vtu")
    assert list(ties["types"].ravel()) == [3]
    assert ties["force"].ravel() == pytest.approx([2000.0])
    assert ties["utilisation"].ravel() == pytest.approx([1.0])
    assert names(tmp_path / "ties.vtu", "ties") == ['"stay"']
    assert names(tmp_path / "ties.vtu", "states")[int(ties["state"][0, 0])] == "yields"
    assert ties["displacement"][0, 0] > 0.0
    assert not np.any(ties["displacement"][1])
    loads = arrays(tmp_path / "loads.vtu")
    keys = names(tmp_path / "loads.vtu", "loads")
    by_key = {keys[int(load)]: k for k, load in enumerate(loads["load"].ravel())}
    for key, force, place in (
        ("loads.dead.body", [0.0, 0.0, -20000.0], [0.5, 0.5, 1.0]),
        ("floors.<top>", [0.0, 0.0, -500.0], [0.5, 0.5, 2.0]),
        ("loads.live.body", [20000.0, 0.0, 0.0], [0.5, 0.5, 1.0]),
    ):
        assert loads["force"][by_key[key]] == pytest.approx(force, abs=1e-6), key
        assert loads["Points"][by_key[key]] == pytest.approx(place), key


def test_paraview_files(tipping, tmp_path):
    write_fields(tipping, tmp_path)
    blocks = arrays(tmp_path / "blocks.vtu")
    assert list(blocks["types"].ravel()) == [42, 42, 42]
    assert list(blocks["faceoffsets"].ravel()) == [31, 62, 93]
    assert list(blocks["faces"][:6].ravel()) == [6, 4, 0, 3, 2, 1]
    top = blocks["Points"][:, 2] == 2.0
    # It turns about x = 0.5, z = 0: 8 % of the height at the farthest corner.
    left = top & (blocks["Points"][:, 0] == -0.5)
    assert blocks["displacement"][left] == pytest.approx(
        np.tile([2.0, 0.0, 1.0], (2, 1)) * 0.16 / 5**0.5, rel=1e-6
    )
    contacts = arrays(tmp_path / "contacts.vtu")
    assert sorted(contacts["pressure"].ravel()) == pytest.approx([1.0, 2.0])
    # The foot opens upwards by up to 1 / 5^.5 of the motion, at its back, and does not slide.
    rows = np.all(contacts["Points"] == [-0.5, 0.5, 0.0], axis=1)
    up = np.array([[0.0, 0.0, 0.16 / 5**0.5]])
    assert contacts["opening"][rows] == pytest.approx(up, abs=1e-9)
    assert contacts["displacement"][rows] == pytest.approx(0.5 * up, abs=1e-9)
    assert contacts["slip"] == pytest.approx(np.zeros_like(contacts["slip"]), abs=1e-9)
    assert names(tmp_path / "contacts.vtu", "states")[int(contacts["state"].max())] == "rocks"
    assert names(tmp_path / "blocks.vtu", "groups") == ["tower", "ground"]
    assert "utilisation" not in blocks
    series = ElementTree.parse(tmp_path / "collapse.pvd").findall(".//DataSet")
    assert [one.get("timestep") for one in series][::5] == ["0", "0.5", "1"]
    last = arrays(tmp_path / series[-1].get("file"))
    assert last["Points"] == pytest.approx(blocks["Points"] + blocks["displacement"])


def test_vtk_reads_the_files(tipping, tmp_path):
    vtk = pytest.importorskip("vtk")
    write_fields(tied_wall(), tmp_path)
    for name, legend in (("ties", "ties"), ("loads", "loads"), ("contacts", "states")):
        reader = vtk.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(tmp_path / f"{name}.vtu"))
        reader.Update()
        told = reader.GetOutput().GetFieldData().GetArray(legend)
        shown = [told.GetComponentName(k) for k in range(told.GetNumberOfComponents())]
        assert shown == names(tmp_path / f"{name}.vtu", legend)
        assert reader.GetOutput().GetPointData().GetArray("displacement").GetMaxNorm() > 0.0
    write_fields(tipping, tmp_path)
    for name, measure, whole in (("blocks", "Volume", 9.2), ("contacts", "Area", 2.0)):
        reader = vtk.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(tmp_path / f"{name}.vtu"))
        sizes = vtk.vtkCellSizeFilter()
        sizes.SetInputConnection(reader.GetOutputPort())
        sizes.Update()
        values = sizes.GetOutput().GetCellData().GetArray(measure)
        total = sum(values.GetValue(k) for k in range(values.GetNumberOfTuples()))
        assert total == pytest.approx(whole)


def test_meshio_reads_the_files(tipping, tmp_path):
    meshio = pytest.importorskip("meshio")
    write_fields(tied_wall(), tmp_path)
    for name, kind in (("ties", "line"), ("loads", "vertex"), ("contacts", "polygon")):
        read = meshio.read(tmp_path / f"{name}.vtu")
        assert [one.type for one in read.cells] == [kind]
        assert read.point_data["displacement"].shape == read.points.shape
    write_fields(tipping, tmp_path)
    blocks = meshio.read(tmp_path / "blocks.vtu")
    assert [(cells.type, len(cells)) for cells in blocks.cells] == [("polyhedron8", 3)]


# ---- pictures

FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def colour_at(blocks, turn, place, falling):
    """What is seen at a place of a view of blocks at rest."""
    structure = structure_of(blocks, 0.5, [1.0, 0.0, 0.0])
    view = view_of(structure, Collapse("unstable", falling=(falling,)))
    figure = Figure(figsize=(4, 4), dpi=50)
    axes = figure.add_axes([0, 0, 1, 1])
    draw_view(axes, view, turn)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    x, y = axes.transData.transform(place)
    pixels = np.asarray(canvas.buffer_rgba())
    return pixels[len(pixels) - 1 - int(y), int(x), :3].astype(int)


def test_the_nearest_block_is_seen():
    # The beam's centroid is nearer to the eye than the post's, but the beam passes behind it.
    post = box([0, 0, 0], [0.4, 0.4, 2], "post")
    plan = [(-0.2, 1.1), (6.0, -5.1), (6.0, -4.9), (-0.2, 1.3)]
    corners = [(x, y, z) for z in (0.8, 1.2) for x, y in plan]
    beam = Block((Polyhedron.hexahedron(corners),), "beam")
    for blocks, falling in (((post, beam), 1), ((beam, post), 2)):
        for height in (0.5, 1.0, 1.5):
            seen = colour_at(blocks, FRONT, (0.2, height), falling)
            assert seen[0] > seen[2] + 40, height  # orange
        seen = colour_at(blocks, FRONT, (1.0, 1.0), falling)
        assert np.ptp(seen) < 10  # grey


def blue_pixels(blocks, slides):
    """How much blue there is from the front where one block slides to x."""
    structure = structure_of(blocks, 0.5, [1.0, 0.0, 0.0])
    mode = np.zeros((len(blocks) + 1, 6))
    mode[slides, 0] = 1.0
    figure = Figure(figsize=(4, 4), dpi=150)
    axes = figure.add_axes([0, 0, 1, 1])
    view = view_of(structure, Collapse("limit", 1.0, mode=mode))
    draw_view(axes, view, FRONT)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    red, _, blue = np.moveaxis(np.asarray(canvas.buffer_rgba())[..., :3].astype(int), -1, 0)
    return np.count_nonzero(blue > red + 100)


def test_marks_of_the_back_are_not_among_those_of_the_front():
    posts = (box([-2, -2, 0], [-1, -1, 2]), box([1, -2, 0], [2, -1, 2]))
    back = box([-0.5, 1, 0], [0.5, 2, 2])
    beside = box([-3, 1, 0], [-2.1, 2, 2])
    assert blue_pixels((*posts, back), 1) > 10
    assert blue_pixels((*posts, back), 3) == 0
    assert blue_pixels((back,), 1) > 10
    assert blue_pixels((*posts, beside), 3) > 10, "no block is before it"


def test_what_is_behind_an_opening_is_not_seen():
    """From the front; a gable of the back above the front wall is."""
    left, right = box([-2, -2, 0], [-0.5, -1.5, 2]), box([0.5, -2, 0], [2, -1.5, 2])
    lintel = box([-2, -2, 2], [2, -1.5, 2.4])
    back, gable = box([-2, 1.5, 0], [2, 2, 2.4]), box([-2, 1.5, 2.4], [2, 2, 3])
    blocks = (left, right, lintel, back, gable)
    assert colour_at(blocks, FRONT, (0.0, 1.0), 4).min() == 255
    assert colour_at(blocks, FRONT, (0.0, 2.7), 4).min() < 250
    aside = axes_to(VIEWS[3]["oblique"])
    assert colour_at(blocks, aside, (aside[:2] @ [0.0, 1.5, 1.0]), 4).min() < 250


def test_arrows_end_where_loads_act(tmp_path):
    """A force has its head on top of the block, with it when that is displaced; so have floors."""
    tables = {
        "dimension": 3,
        "title": "Post",
        "blocks": {"a": {"box": [[0, 0, 0], [1, 1, 2]]}},
        "materials": {"default": {"density": 1000.0}},
        "joints": {"default": {"friction": 0.8}},
        "floors": {"roof": {"z": 2.0, "force": 500.0, "thrust": [0.0, -50.0]}},
        "loads": {
            "dead": {"body": [0.0, 0.0, -10.0]},
            "live": {"force": {"hit": {"force": [1e3, 0.0, 0.0], "at": [0.0, 0.5, 2.0]}}},
        },
        "solve": {"direction": "both"},
    }
    result = limit_load(Scene.from_tables(tables, Path()))
    for name, view in views_of(result).items():
        sign = result.ends[name].sign
        tops = np.array([[0.0, 0.5, 2.0], [0.5, 0.5, 2.0]])
        hit, middle = tops + view.displacements(tops, view.bodies.names.index("a"))
        way = {"live forces": (hit, [sign, 0, 0]), "floors": (middle, [0, 0, -1])}
        way["thrust of floors"] = (middle, [0, -1, 0])
        assert set(view.arrows) == set(way)
        for kind, (place, along) in way.items():
            ((tail, tip),) = view.arrows[kind]
            assert tip == pytest.approx(place)
            assert (tip - tail) / np.linalg.norm(tip - tail) == pytest.approx(along)
    draw_collapse(result, tmp_path, OutputOptions(formats=("svg",)))
    words = (tmp_path / "collapse.svg").read_text()
    assert all(f"<!-- {one} -->" in words for one in ("floors", "thrust of floors", "live forces"))


def test_hinges_that_crush_show_both(tipping):
    """Orange on violet at the foot; the state of the contact is what it does."""
    view = view_of(tipping.structure, tipping.collapse)
    foot = view.contacts.state == ContactState.ROCKS
    touching = replace(view.touching, crushes=np.ones(len(foot), dtype=bool))
    view = replace(view, touching=touching)
    assert list(view.contacts.state[foot]) == [ContactState.ROCKS]
    assert list(view.contacts.state[~foot]) == [ContactState.CRUSHES]
    axes = Figure().subplots()
    draw_view(axes, view, FRONT)
    drawn = [to_hex(colour) for colour in axes.collections[0].get_edgecolors()]
    violet, orange = (np.flatnonzero(np.array(drawn) == one.lower()) for one in (FORCE, ORANGE))
    assert len(violet) > len(orange) > 0
    assert violet.min() < orange.min()


def test_a_wall_has_one_view(tmp_path):
    wall = (box([-1, -0.2, 0], [1, 0.2, 1]), box([-1, -0.2, 1], [1, 0.2, 2]))
    for name, direction, motion in (
        ("front (x, z)", [1, 0, 0], "in"),
        ("oblique", [0, 1, 0], "out of"),
    ):
        structure = structure_of(wall, 0.8, direction)
        result = SpatialLimit(None, structure, {"positive": collapse_of(structure)})
        draw_collapse(result, tmp_path, OutputOptions(formats=("svg",)))
        words = (tmp_path / "collapse.svg").read_text()
        shown = [view for view in VIEWS[3] if f"<!-- {view} -->" in words]
        assert shown == [name], f"it moves {motion} its plane"


def test_pictures_are_written(tipping, tmp_path):
    both = {"positive": tipping.collapse, "negative": tipping.collapse}
    output = OutputOptions(formats=("png", "svg"))
    assert draw_collapse(SpatialLimit(None, tipping.structure, both), tmp_path, output) == []
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [
        f"collapse{end}.{kind}" for end in ("", "_negative") for kind in ("png", "svg")
    ]
    words = (tmp_path / "collapse.svg").read_text()
    assert "oblique" in words


# ---- the viewer


def test_viewer_needs_no_other_file(tipping, tmp_path):
    write_viewer(views_of(tipping), tmp_path)
    page = (tmp_path / "viewer.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|src=|href=|@import|url\(", page)
    data = json.loads(re.search(r'application/json">(.*)</script>', page).group(1))
    assert [block["name"] for block in data["blocks"]] == ["ground", "lower", "upper"]
    assert data["views"][0]["share"] == pytest.approx([0.0, 2**0.5 / 5**0.5, 1.0], abs=1e-3)


def test_viewer_is_small_and_holds_any_name():
    count = 60
    names = [f"</script><b>{number}" for number in range(count)]
    row = [box([k, 0, 0], [k + 1, 1, 1.1234], names[k]) for k in range(count)]
    structure = structure_of(row, 0.5, [1, 0, 0])
    mode = np.random.default_rng(0).normal(size=(count + 1, 6))
    collapse = Collapse("limit", 1.0, mode=mode)
    whole = SpatialLimit(None, structure, {"positive": collapse})
    page = viewer_page(views_of(whole))
    smaller = SpatialLimit(
        None, structure_of(row[:1], 0.5, [1, 0, 0]), {"positive": replace(collapse, mode=mode[:2])}
    )
    empty = viewer_page(views_of(smaller))
    assert page.count("</script>") == 2
    assert len(page) - len(empty) < 600 * count


def test_ties_are_drawn(tipping, tmp_path):
    tie = Tie(from_=(0.0, 0.0, 1.5), ground=(2.0, 0.0, 0.0), yield_=1.0)
    bar = Bar("ties.stay", tie, (2, -1), np.array([tie.from_, tie.ground]))
    structure = replace(tipping.structure, bars=(bar,))
    result = SpatialLimit(None, structure, dict(tipping.ends))
    view = view_of(structure, replace(tipping.collapse, tension=np.array([1.0])))
    (ends,) = view.moved_ties
    assert ends[0] == pytest.approx([0.24 / 5**0.5, 0.0, 1.5 + 0.08 / 5**0.5])
    assert ends[1] == pytest.approx([2.0, 0.0, 0.0])
    foot = "the whole structure turns about its foot to +x"
    assert mechanism_in_words(view) == f"{foot}, tie stay yields"
    figure = Figure()
    axes = figure.add_subplot()
    draw_view(axes, view, FRONT)
    assert axes.get_xlim()[1] > 2.0, "the tie's end is in the picture"
    draw_collapse(result, tmp_path, OutputOptions(formats=("svg",)))
    assert "<!-- tie -->" in (tmp_path / "collapse.svg").read_text()
    data = json.loads(
        re.search(r'application/json">(.*)</script>', viewer_page(views_of(result))).group(1)
    )
    assert data["ties"] == [[2, -1, [[0.0, 0.0, 1.5], [2.0, 0.0, 0.0]]]]


# ---- words


def words(structure, collapse=None):
    return mechanism_in_words(view_of(structure, collapse or collapse_of(structure)))


def test_words_for_simple_motions(tipping, sliding):
    assert words(tipping.structure) == "the whole structure turns about its foot to +x"
    assert "slides to +y" in words(sliding.structure)
    # Beside a wall that stays.
    stays = Block((Polyhedron.box([0.5, -0.5, 0], [1, 0.5, 2]),), "wall", fixed=True)
    structure = structure_of((box([-0.5, -0.5, 1], [0.5, 0.5, 2]), stays), 0.5, [1, 0, 0])
    mode = np.zeros((3, 6))
    for velocity, turn, told in (
        ([0, 0, 0], [0, 0, 1], "twists about an upright axis"),
        ([-1, 0, 0], [0, 0, 0.5], "moves to -x, twisting"),
        ([0, 0, -1], [0, 0, 0], "slides down"),
        ([-1, 0.9, 0], [0, 0, 0], "moves to -x and +y"),
        ([0, 0.9, 1], [0, 0, 0], "slides up to +y"),
        ([-1, 0, 0], [0, 0, 0], "moves to -x"),
        ([0, -0.5, -0.5], [-1, 0, 0], "swings about its top to -y"),
    ):
        mode[1] = [*velocity, *turn]
        told_here = words(structure, Collapse("limit", 1.0, mode=mode.copy()))
        assert told_here == f"the block {told}"


def test_words_name_walls():
    """A facade that leans out between two side walls of courses in running bond."""
    blocks = builders.facade(length=2.0, side=1.2, height=1.2, thickness=0.2, brick=(0.4, 0.2))
    material = {"default": Material(density=2000.0)}
    scene = Scene(
        blocks=blocks,
        materials=material,
        joints={"default": JointLaw(friction=0.6)},
        dead=Load(body=(0.0, 0.0, -9.81)),
        live=Load(direction=(0.0, -1.0, 0.0)),
        solve=SolveOptions(quick=True),
    )
    told = words(scene.structure())
    assert re.match(r"the facade \(\d+ blocks\) turns about its foot to -y", told), told
    assert "the left wall and the right wall crack" in told


def test_words_name_what_parts_are_made_of():
    """Two piers of three stones of which the left one leans; its highest stone alone slides."""
    stones = [
        box([x, 0, k], [x + 1, 1, k + 1], f"pier_{x + 3}_{k}", "piers")
        for x in (-2, 1)
        for k in range(3)
    ]
    tops = [box([x, 0, 3], [x + 1, 1, 4], f"cap_{x + 3}", "caps") for x in (-2, 1)]
    structure = structure_of((*stones, *tops), 0.5, [1, 0, 0])
    mode = np.zeros((9, 6))
    leans = [1, 2, 3, 7]
    mode[leans, 4] = -0.2
    mode[leans, 0] = -0.2 * np.array([0.5, 1.5, 2.5, 3.5])
    mode[leans, 2] = 0.2 * 0.5
    told = words(structure, Collapse("limit", 1.0, mode=mode.copy()))
    assert "the left part (4 blocks of the piers and the caps) turns" in told, told
    assert "crack" not in told
    mode = np.zeros((9, 6))
    mode[7, 0] = 1.0
    told = words(structure, Collapse("limit", 1.0, mode=mode))
    assert told == "the left part of the caps (1 block) slides to +x", told


def test_words_are_few_where_all_goes_to_pieces():
    row = [box([k, 0, 0], [k + 1, 1, 1], str(k)) for k in range(8)]
    mode = np.zeros((9, 6))
    mode[1:, 1] = np.where(np.arange(8) % 2, 1.0, -1.0)
    structure = structure_of(row, 0.5, [0, 1, 0])
    told = words(structure, Collapse("limit", 1.0, mode=mode))
    assert told.endswith(", 6 smaller parts move between these")
    assert told.count("slides to") == 2
