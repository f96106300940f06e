"""The report: one page for every status and direction, true to result.json, safe for any text."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from fenics_contact.geometry.gmsh_mesh import gmsh_session
from fenics_contact.meshing import polygons
from fenics_contact.output.report.answer import LEAST, MOST, picture_height
from fenics_contact.output.report.content import Content, Labels
from fenics_contact.output.report.page import report_page
from tests.bank import sides
from tests.drawing import rectangle
from tests.quick import quick, slow_rows
from tests.system.program import LEFT_OUT, changed, result, run, run_here, toml, write_scene

SMALL = {"output.paraview": False, "output.pictures": False, "output.report": True}
DRAWN = {"output.pictures": True}
STEEP = {"foundations.base.friction": 0.3, "joints": {}}
JAMMED = {
    "foundations": {"left": {"friction": 0.5}, "right": {"friction": 0.5}},
    "joints": LEFT_OUT,
    "loads.live.body": [0.0, 9.81],
}

#: Changes of the scene, mesh, words that the page must have.
SCENES: dict[str, tuple[dict[str, Any], str, list[str]]] = {
    "limit": ({}, "block", ["0.30000", "1 of 1 block move", "1 slides while closed"]),
    "unbounded": (
        {"loads.live.body": [0.0, -9.81]},
        "block",
        ["no limit", "1 of 1 block wedge: 0."],
    ),
    "unstable": ({}, "overhang", ["2 of 3 blocks move: 1, 2.", "2 at (1.3, 0.5) turn."]),
    "no_equilibrium": (JAMMED, "block", ["no equilibrium was found under the dead load alone"]),
    "not_converged": (
        {"materials.default.poisson": 0.4999999999999999, "solve.engine": "faces"},
        "block",
        ["not verified"],
    ),
}
#: The mark-up of the page.
TAGS = set("html head meta title style body h1 h2 h3 p ul li table tr th td figure img".split())
TAGS |= set("figcaption section div iframe thead tbody".split())
#: Its attributes.
ATTRIBUTES = set("src srcdoc alt class scope lang charset name content title style".split())


class Page(HTMLParser):
    """A page read strictly: every element is known, closed in order, and needs no other file."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.pictures: list[str] = []
        self.cells: list[list[str]] = []
        self.text = ""
        self.answer = ""
        self.blocks: list[list[dict[str, Any]]] = []  # of pages that move them
        self.kind: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        assert tag in TAGS and set(given) <= ATTRIBUTES
        if tag == "img":
            assert (given["src"] or "").startswith("data:image/")
            self.pictures.append(given["alt"] or "")
        if tag == "iframe":
            data = re.search(r'application/json">(.*?)</script>', given["srcdoc"] or "")
            assert data is not None
            self.blocks.append(json.loads(data.group(1))["blocks"])
        if tag == "tr":
            self.cells.append([])
        if tag in ("td", "th"):
            self.cells[-1].append("")
        if tag not in ("img", "meta"):
            self.open.append(tag)
            self.kind.append(given.get("class") or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        self.kind.pop()

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            assert "url" not in data and "@import" not in data
            return
        self.text += data
        if self.kind and self.kind[-1].startswith("status"):
            self.answer += data
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1][-1] += data

    def row(self, name: str) -> list[str]:
        """The cells beside the first one with a name."""
        return next(cells[1:] for cells in self.cells if cells[:1] == [name])


def page_of(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def solved(folder: Path, capsys: Any, changes: dict[str, Any], mesh: str) -> tuple[Page, Any]:
    """Page and result.json of a scene."""
    write_scene(folder, SMALL | changes, mesh)
    run_here(["solve", "scene.toml"], capsys)
    return page_of(folder / "scene"), result(folder / "scene")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "direction",
    ["both", *(pytest.param(one, marks=pytest.mark.slow) for one in ("positive", "negative"))],
)
@pytest.mark.parametrize("status", SCENES)
def test_every_status_has_its_page(status, direction, folder, capsys):
    changes, mesh, words = SCENES[status]
    page, record = solved(folder, capsys, changes | DRAWN | {"solve.direction": direction}, mesh)
    if direction == "positive":
        assert record["status"] == status
        assert [word for word in words if word not in page.text] == []
    assert page.text.count("Load factor, ") == len(record["directions"])
    assert (len(record["directions"]) == 2) == (direction == "both" and status != "unstable")
    drawn = {name for name in record["files"] if name.endswith(".png")}
    assert len(page.pictures) == len(drawn)
    assert page.answer


def test_numbers_are_those_of_the_result(folder, capsys):
    page, record = solved(folder, capsys, {"solve.direction": "both"}, "wall")
    factors = [cells[1] for cells in page.cells if cells[:1] == ["load factor"]]
    assert [float(text) for text in factors] == pytest.approx([0.3, -0.3])
    assert page.row("carried without any friction") == ["nothing"]
    assert float(page.row("surely not carried beyond")[0]) == pytest.approx(0.3)
    assert "Young's modulus 1000 MPa" in page.row("default")[0]
    rows = [cells for cells in page.cells if cells[-1:] == ["yes"] and len(cells) == 5]
    ends = record["directions"].values()
    assert len(rows) == sum(len(end["residuals"]) for end in ends)
    assert set(record["tolerances"]) == set(record["residuals"])
    assert page.row("petsc")[0].count(".") == 2


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_residual_that_fails_is_seen(folder, capsys):
    _, record = solved(folder, capsys, {}, "block")
    for value in (1.0, None):
        record["directions"]["positive"]["residuals"]["friction"] = value
        page = Page(report_page(Content(record)))
        assert page.row("friction")[-1] == "NO"
        assert page.row("no tension")[-1] == "yes"


def test_blocks_and_joints_of_a_mechanism_are_counted(folder, capsys):
    rough = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
    _, record = solved(folder, capsys, rough, "tower")
    moves = record["directions"]["positive"]["mechanism"]
    assert moves["moving"] == moves["turning"] == [0, 1] and moves["fastest"] == 1
    counts = [moves[key] for key in ("joints", "parting", "rocking", "sliding")]
    assert counts == [2, 0, 1, 0]
    assert moves["centre"] == pytest.approx([0.25, 0.75])
    _, record = solved(folder, capsys, {}, "tower")
    moves = record["directions"]["positive"]["mechanism"]
    assert moves["moving"] == [0, 1] and moves["turning"] == []
    counts = [moves[key] for key in ("joints", "parting", "rocking")]
    assert counts == [2, 0, 0] and moves["sliding"] >= 1
    assert moves["direction"] == pytest.approx([1.0, 0.0], abs=1e-3)


HOSTILE = '<script>alert("1")</script> & "quotes\' <b> \u202e \\ $x$'


def test_any_text_is_text(folder, capsys):
    _, record = solved(folder, capsys, {"title": HOSTILE}, "block")
    scene = record["scene"]
    scene["materials"][HOSTILE] = scene["materials"].pop("default")
    scene["loads"]["live"]["traction"] = {HOSTILE: [1.0, 2.0]}
    scene["supports"] = {HOSTILE: HOSTILE}
    record["warnings"] = [HOSTILE, "\ud800\x00"]
    pictures = {"collapse": 'data:image/png;base64,"><script>'}
    labels = Labels(HOSTILE, HOSTILE)
    page = Page(report_page(Content(record, pictures, labels=labels)))
    shown = HOSTILE.replace("\u202e", "\\u202e")
    assert page.text.count(shown) >= 8
    assert "Young's modulus 1000 MPa" in page.row(shown)[0]
    report_page(Content(record)).encode("utf-8")


LOADS = {
    "joints.default.cohesion": 2e3,
    "loads.dead.tilt": 1.5,
    "loads.live.force": {"P": {"force": [10.0, 0.0], "x": 0.0, "y": 0.4}},
    "loads.dead.earth": {"left": {"level": 0.5, "unit_weight": 100.0}},
}


def test_loads_have_places_and_units(folder, capsys):
    page, _ = solved(folder, capsys, LOADS, "block")
    texts = [" ".join(cells) for cells in page.cells]
    assert "cohesion 0.002 MPa" in page.row("joint default")[0]
    assert "dead tilt 1.5 degrees" in texts
    force = "force (0.01, 0) kN per metre of thickness, x 0 m, y 0.4 m"
    assert f"live force P {force}" in texts
    earth = next(text for text in texts if text.startswith("dead earth left"))
    assert "level 0.5 m, unit weight 0.1 kN/m3, coefficient 1" in earth


FLOORS = {
    "storey": {"force": 120.0, "at": "top", "mass": True},
    "roof": {"force": 50.0, "y": 0.5, "x": [0.0, 0.25]},
}


def test_floors_are_among_the_loads(folder, capsys):
    page, record = solved(folder, capsys, {"floors": FLOORS}, "block")
    texts = [" ".join(cells) for cells in page.cells]
    storey = "floor storey{} 0.12 kN/m2 on top, with its mass"
    roof = "floor roof{} 0.05 kN/m2 at y = 0.5 m, x from 0 m to 0.25 m, without its mass"
    told = [one.format(force) for one in (storey, roof) for force in ("", " force")]
    assert all(one in texts for one in told)
    assert "sideways on all masses" not in page.text  # the roof has none
    assert record["scene"]["floors"]["storey"] == FLOORS["storey"]


def test_a_picture_of_an_earlier_result_is_left_out(folder, capsys):
    page, _ = solved(folder, capsys, DRAWN | {"output.capacity": 3}, "block")
    assert len(page.pictures) == 6
    page, record = solved(folder, capsys, {}, "block")
    assert (folder / "scene" / "capacity.png").exists()
    assert page.pictures == [] and record["files"] == []


@pytest.mark.parametrize("kept", [b"damaged", b"PK", None])
def test_pictures_that_cannot_be_drawn_any_more_are_named(kept, folder, capsys):
    write_scene(folder, DRAWN | {"output.paraview": False}, "block")
    assert run_here(["solve", "scene.toml", "-q"], capsys).code == 0
    figures = folder / "scene" / "figures.npz"
    figures.unlink()
    if kept is not None:
        figures.write_bytes(kept)
    found = run_here(["report", "scene"], capsys)
    reason = "is not there" if kept is None else "is damaged"
    line = f"pictures that are missing: figures.npz {reason}"
    assert (found.code, found.err) == (0, "")
    assert found.out.splitlines()[0] == f"warning: {line}"
    page = page_of(folder / "scene")
    assert len(page.pictures) == 1 and line[1:] in page.text


def test_report_of_a_folder(folder, capsys):
    solved(folder, capsys, {}, "block")
    text = (folder / "scene" / "report.html").read_text()
    found = run_here(["report", "scene", "-o", "page.html"], capsys)
    assert (found.code, found.out, found.err) == (0, "written to page.html\n", "")
    assert (folder / "page.html").read_text() == text
    assert run_here(["report", "scene", "-q"], capsys).out == ""


NO_RESULT = {
    "no folder": None,
    "no JSON": "{",
    "no text": b"\xff",
    "no result": '{"status": "limit"}',
    "a list": "[]",
    "damaged": json.dumps({"status": "limit", "directions": {}, "scene": {}, "title": ""}),
}


@pytest.mark.parametrize("name", NO_RESULT)
def test_2_without_a_result(name, folder, capsys):
    content = NO_RESULT[name]
    if content is not None:
        (folder / "out").mkdir()
        data = content if isinstance(content, bytes) else content.encode()
        (folder / "out" / "result.json").write_bytes(data)
    found = run_here(["report", "out"], capsys)
    assert (found.code, found.out) == (2, "")
    assert found.err.count("\n") == 1 and "out/result.json" in found.err and "solve" in found.err
    assert not (folder / "out" / "report.html").exists()


def test_4_where_the_page_cannot_be_written(folder, capsys):
    solved(folder, capsys, {}, "block")
    found = run_here(["report", "scene", "-o", "no/page.html"], capsys)
    assert found.code == 4 and found.err.startswith("fenics-contact: cannot write 'no/page.html'")


NO_PAGES = [
    (["-o", "scene/result.json"], ".html"),
    (["-o", "scene/collapse.png"], ".html"),
    (["-o", "scene"], ".html"),
    (["-o", "page.pdf"], ".html"),
    (["--pdf", "scene/result.json"], ".pdf"),
    (["--pdf", "scene.toml"], ".pdf"),
]


def test_no_file_but_a_page_is_overwritten(folder, capsys):
    solved(folder, capsys, DRAWN, "block")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for arguments, ending in NO_PAGES:
        found = run_here(["report", "scene", *arguments], capsys)
        assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
        assert f"{arguments[1]}: a file that ends with {ending} is written" in found.err
        assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.slow
def test_ranks_write_the_same_page(tmp_path):
    write_scene(tmp_path, SMALL, "wall")
    records = []
    for ranks in (1, 3):
        found = run(["solve", "scene.toml", "-o", f"out{ranks}"], tmp_path, ranks)
        assert found.code == 0, found.err
        record = result(tmp_path / f"out{ranks}")
        records.append((record["scene"], record["directions"]["positive"]["mechanism"]))
        found = run(["report", f"out{ranks}", "-o", f"{ranks}.html"], tmp_path, ranks)
        assert found.out == f"written to {ranks}.html\n"
    (one_scene, one), (scene, moves) = records
    assert scene["contacts"] == one_scene["contacts"]
    assert scene["resultants"]["dead"] == pytest.approx(one_scene["resultants"]["dead"])
    for key in ("moving", "turning", "joints", "parting", "rocking", "sliding"):
        assert moves[key] == one[key]


def test_seismic_check_has_its_table(folder, capsys):
    changes = {"seismic.confidence_factor": 1.2, "solve.direction": "both"}
    page, record = solved(folder, capsys, changes, "wall")
    assert page.text.count("Seismic check of this mechanism") == 2
    check = record["seismic"]["negative"]
    assert record["scene"]["seismic"] == {"confidence_factor": 1.2}
    assert page.row("confidence factor FC") == ["1.2"]
    assert float(page.row("participating fraction e*")[0]) == pytest.approx(check["mass_fraction"])
    assert check["acceleration_g"] == pytest.approx(0.3 / 1.2, rel=1e-5)  # it slides as a whole


def test_profile_is_among_the_loads(folder, capsys):
    table = {"loads.live.profile": [[0.0, 0.5], [1.0, 2.0]]}
    page, record = solved(folder, capsys, table, "block")
    assert record["scene"]["loads"]["live"]["profile"] == [[0.0, 0.5], [1.0, 2.0]]
    (row,) = (cells for cells in page.cells if cells[1:2] and cells[1].startswith("factor on the"))
    assert row[2] == "((0, 0.5), (1, 2))"
    out = run_here(["check", "scene.toml"], capsys).out
    assert "live body force over the height: 0.5 at 0 m, 2 at 1 m" in out


def ends_of(record: Any, *given: float | str) -> Any:
    """A record whose ends have other load factors, or a status in place of one."""
    end = next(iter(record["directions"].values()))
    changes = [{"status" if isinstance(one, str) else "load_factor": one} for one in given]
    ends = dict(zip(("positive", "negative"), changes, strict=False))
    directions = {name: {**end, **change} for name, change in ends.items()}
    return record | {"directions": directions, "ways": dict.fromkeys(directions, "")}


def test_the_answer_is_that_of_the_console(folder, capsys):
    page, record = solved(folder, capsys, {"loads.live.body": [9.81, 0.0]}, "block")
    assert page.answer == "It collapses at 0.3000 g to the right (verified)."
    assert record["answer"]["question"] in page.text
    assert "The block slides to the right." in page.text
    assert "No other collapse state exists." in page.text and "Blocks do not crack" in page.text


def test_directions_that_end_differently_have_a_verdict_each(folder, capsys):
    _, record = solved(folder, capsys, {"loads.live.body": [9.81, 0.0]}, "block")
    reason = "no state was found; the path wanders; try a finer mesh"
    tried = {"name": "interior point", "outcome": "residual 1", "factorizations": 36}
    ends = ends_of(record | {"status": "not_converged"}, 0.3, "not_converged")
    ends["directions"]["negative"] |= {"reason": reason, "attempts": [tried], "load_factor": None}
    page = Page(report_page(Content(ends)))
    verdict = "Live load as given: verified, see the appendix. Live load reversed: not converged"
    assert verdict in page.text
    assert "The numbers below are not a limit load" not in page.text
    assert "Reason: no state was found. The appendix has what was tried." in page.text
    assert page.text.index("wanders") > page.text.index("Appendix: how it was computed")
    assert page.row("interior point") == ["residual 1", "36"]


def test_how_many_blocks_move_and_turn(folder, capsys):
    _, record = solved(folder, capsys, {}, "tower")
    moves = record["directions"]["positive"]["mechanism"]
    record["mesh"]["bodies"] = 4
    moves |= {"moving": [0, 1, 3], "turning": [], "parting": 1, "rocking": 0, "sliding": 2}
    text = Page(report_page(Content(record))).text
    assert "3 of 4 blocks move, none turn. Of" in text
    assert "joints 1 opens over the whole length and 2 slide while closed." in text
    moves |= {"moving": [1], "turning": [1], "parting": 0, "sliding": 0}
    text = Page(report_page(Content(record))).text
    assert "1 of 4 blocks move, 1 turn. Of" in text
    assert "joints none opens or slides." in text


TIED = {
    "materials.default.compressive_strength": 2e5,
    "ties": {
        "rod": {"from": [0.1, 0.4], "ground": [0.1, -0.5], "yield": 100.0},
        "bar": {"from": [0.2, 0.4], "ground": [0.2, -0.5], "yield": 90.0, "spacing": 0.75},
    },
    "foundations.base.friction": 0.9,
    "joints.default.friction": 0.9,
    "plane.thickness": 0.5,
}


def test_strengths_that_crush_and_ties_have_their_numbers_and_units(folder, capsys):
    page, record = solved(folder, capsys, TIED, "tower")
    assert record["status"] == "limit" and record["crushing"]
    assert "They do not crush" not in page.text and "joints crush at the" in page.text
    assert page.row("default")[0].endswith("compressive strength 0.2 MPa")
    place = record["crushing"][0]
    (row,) = (cells for cells in page.cells if cells[1:2] == ["base"] and "mm" in cells[2])
    assert row[2:] == [
        f"{1e3 * place['length']:.3g} mm",
        f"{0.5e-3 * place['normal_force']:.3g} kN",
    ]
    assert page.row("tie rod") == ["yields at 0.05 kN"]  # of the whole thickness
    assert page.row("tie bar") == ["yields at 0.09 kN, one every 0.75 m"]
    (rod,) = (tie for tie in record["ties"] if tie["name"] == "rod")
    tension, limit = f"{0.5e-3 * rod['force']:.4g} kN", f"{0.5e-3 * rod['yield']:.4g} kN"
    assert page.row("rod") == [tension, limit, rod["state"]]
    where = "from (0.2, 0.4) m to the ground at (0.2, -0.5) m"
    assert ["bar", where, "yields at 0.09 kN, one every 0.75 m"] in page.cells


CRUSHES = {
    "materials.default.compressive_strength": 1e5,
    "joints.default.friction": 2.0,
    "foundations.base.friction": 2.0,
    "output.capacity": 4,
}


@pytest.mark.parametrize("changes", [{"solve.engine": "faces"}, CRUSHES], ids=["faces", "crushing"])
def test_what_is_proved_by_the_forces_of_faces(changes, folder, capsys):
    page, record = solved(folder, capsys, changes | DRAWN, "block")
    (end,) = record["directions"].values()
    assert f"{end['proof'][1:]}." in page.text and "Collapses at" in page.text
    cone = "the friction cone" + " and the compressive strengths" * (changes is CRUSHES)
    assert f"there is an equilibrium inside {cone} at" in page.text
    assert page.row("model")[0].startswith("rigid blocks with elastic faces: no error by a mesh")
    assert ["error by the mesh", "not estimated"] not in page.cells
    assert "carried on the way" not in page.text and "accuracy: " not in page.text
    (stress,) = (words for words in page.pictures if words.startswith("Principal stresses"))
    assert "under the joint forces of the state" in stress
    asked = "capacity curve: no loading path leads to a limit load by the forces of joint faces"
    assert (asked in page.text) == ("output.capacity" in changes)
    assert not any(words.startswith("Capacity") for words in page.pictures)


def test_what_rounding_leaves_of_a_resultant_is_0(folder, capsys):
    live = {
        "loads.live.body": [0.0, 0.0],
        "loads.live.earth": {"left": {"level": 0.5, "unit_weight": 100.0}},
    }
    page, _ = solved(folder, capsys, live, "block")
    assert page.row("live load at load factor 1")[0].endswith(", 0) kN per metre of thickness")


def test_loads_that_are_no_weight_are_carried_so_many_times(folder, capsys):
    live = {"loads.live.body": [0.0, 0.0], "loads.live.traction": {"left": [100.0, 0.0]}}
    page, record = solved(folder, capsys, live, "block")
    times = f"{record['load_factor']:.4g} times the live load of 0.05 kN/m"
    assert page.answer == f"It collapses at {times} (verified)."


def test_units_of_engineers_and_the_thickness(folder, capsys):
    page, record = solved(folder, capsys, LOADS | {"output.units": "mm"}, "block")
    weight = abs(record["scene"]["resultants"]["dead"][1])
    assert page.row("joints default")[0].endswith("cohesion 0.002 MPa, no tensile strength")
    assert "wide and 500 mm high" in page.row("blocks")[0]
    assert page.row("dead load")[0].endswith("kN per metre of thickness")
    assert "y 400 mm" in page.text
    thick, record = solved(folder, capsys, {"plane.thickness": 0.5, **LOADS}, "block")
    assert record["scene"]["resultants"]["dead"][1] == pytest.approx(-weight)
    assert f", {-0.5e-3 * weight:.4g}) kN" in thick.row("dead load")[0]
    assert "metre of thickness" not in thick.row("dead load")[0]


SWEEP = """joints.default.friction,status,load_factor,lower,upper,load_factor_negative
0.2,limit,0.2,,,
0.4,limit,0.31234567,,,
<b>,not_converged,,,,
"""


@pytest.mark.parametrize("place", ["scene", "scene_sweep"])
def test_a_sweep_beside_the_result_is_its_sensitivity(place, folder, capsys):
    solved(folder, capsys, {}, "block")
    beside = folder / place
    beside.mkdir(exist_ok=True)
    (beside / "sweep.csv").write_text(SWEEP)
    (beside / "sweep.json").write_text('{"vary": {"joints.default.friction": [0.2, 0.4, 1]}}')
    assert run_here(["report", "scene"], capsys).code == 0
    page = page_of(folder / "scene")
    assert page.row("0.4") == ["limit", "0.31235"] and page.row("<b>") == ["not converged", "-"]
    assert "the load factor goes from 0.2 to 0.3123." in page.text
    (beside / "sweep.csv").write_text(SWEEP.replace("0.31234567", "abc"))
    assert run_here(["report", "scene"], capsys).code == 0
    assert "Sensitivity" not in page_of(folder / "scene").text


#: Values of a key, changes of the scene, pictures, and the worst case by hand.
SWEEPS = {
    "friction": ("foundations.base.friction=0.1,0.2,0.3", {}, 1, "0.1 at foundations.base", "0.1"),
    "load": ("loads.live.body=[9.81,0]:[19.62,0]:3", {}, 2, "0.15 at loads.live.body", "0.15"),
    "reversed": (
        "foundations.base.friction=0.25,0.3",
        {"solve.direction": "negative"},
        1,
        "-0.25 at foundations.base.friction = 0.25 with the live load reversed",
        "-0.25",
    ),
}


@pytest.mark.parametrize("name", quick(SWEEPS, "load", "reversed"))
def test_a_sweep_has_a_page_of_its_own(name, folder, capsys):
    vary, changes, pictures, worst, bound = SWEEPS[name]
    write_scene(folder, {"joints": {}} | changes)
    assert run_here(["sweep", "scene.toml", "--vary", vary, "-o", "out"], capsys).code == 0
    found = run_here(["report", "out", "--project", "<Gate> $a$"], capsys)
    assert (found.code, found.out, found.err) == (0, "written to out/report.html\n", "")
    page = page_of(folder / "out")
    assert f"The lowest is {worst}" in page.text and f"bracket is {bound} to {bound}." in page.text
    assert "Project: <Gate> $a$" in page.text and "stopped" not in page.text
    assert len(page.pictures) == pictures
    rows = [cells for cells in page.cells if "limit" in cells]
    assert len(rows) == len(list((folder / "out" / "sweep.csv").open())) - 1


def test_a_sweep_that_was_stopped_says_so_and_one_that_cannot_be_read_is_refused(folder, capsys):
    write_scene(folder, {"joints": {}})
    vary = ["--vary", "foundations.base.friction=0.1,0.2,0.3"]
    assert run_here(["sweep", "scene.toml", *vary, "-o", "out"], capsys).code == 0
    path = folder / "out" / "sweep.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:3]))
    assert run_here(["report", "out"], capsys).code == 0
    assert "It was stopped: 2 of 3 points are there." in page_of(folder / "out").text
    (folder / "out" / "report.html").unlink()
    path.write_bytes("".join(lines).encode("utf-16"))
    found = run_here(["report", "out"], capsys)
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert "out/sweep.csv cannot be read as a sweep" in found.err
    assert not (folder / "out" / "report.html").exists()


def test_blocks_are_moved_by_a_page_inside(folder, capsys):
    page, record = solved(folder, capsys, DRAWN | {"solve.direction": "both"}, "wall")
    assert [len(blocks) for blocks in page.blocks] == [record["mesh"]["bodies"]]
    (folder / "scene" / "viewer.html").unlink()
    assert run_here(["report", "scene"], capsys).code == 0
    assert page_of(folder / "scene").blocks == []


@pytest.mark.parametrize(("stones", "place"), [(1, "above"), *slow_rows((4, "beside"))])
def test_assumptions_are_beside_the_picture_of_a_tower(stones, place, folder, capsys):
    """In print both have one page: a picture above long assumptions is lower."""
    stack = [rectangle(0, level, 1, level + 1) for level in range(stones)]
    polygons(stack, 0.5, groups=sides(base=(0, 0, 1, 0)))
    with gmsh_session() as gmsh:
        gmsh.write("block.msh")
    changes = {
        **SMALL,
        **DRAWN,
        "joints.default": {"friction": 0.6},
        "foundations.base.friction": 0.6,
    }
    (folder / "scene.toml").write_text(toml(changed(changes)))
    assert run_here(["solve", "scene.toml", "--fast", "-o", "out"], capsys).code == 0
    page = (folder / "out" / "report.html").read_text()
    Page(page)
    assert f'<div class="{place}" style="--picture: ' in page
    heights = [picture_height([("joints", "friction " * 12)] * rows, []) for rows in range(2, 20)]
    assert heights == sorted(heights, reverse=True)
    assert (heights[0], heights[-1]) == (MOST, LEAST)
