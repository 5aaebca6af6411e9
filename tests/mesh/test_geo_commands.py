"""A .geo file from elsewhere runs no program and touches no file; ordinary ones are meshed."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from support.tiers import stories_except

from fecloth.cli.main import main
from fecloth.errors import InputError, MeshError
from fecloth.mesh import child_process, geo_commands
from fecloth.mesh import read as reading
from fecloth.mesh.geo_commands import check_geo
from fecloth.mesh.read import read

ROOT = Path(__file__).parents[2]
GEO_FILES = sorted([*ROOT.glob("meshes/*.geo"), *ROOT.glob("studies/**/*.geo")])
SQUARE = """h = 0.5;
Point(1) = {0, 0, 0, h}; Point(2) = {1, 0, 0, h};
Point(3) = {1, 1, 0, h}; Point(4) = {0, 1, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1};
"""  # 5 lines
TOUCH = '"touch CANARY"'
LONG = "a" * 1100
EVIL = [  # the lines after the square, and the name that the refusal must have
    ("SystemCall %s;", "SystemCall in line 6"),
    ("\tSystemCall\f\n 'touch CANARY' ;", "SystemCall in line 6"),
    ("SystemCall/* */%s;", "SystemCall in line 6"),
    ("Point(9) = {2, 2, 2};SystemCall %s;", "SystemCall in line 6"),
    ("System\\\nCall %s;", "the character '\\\\' in line 6"),
    ("#include %s", "include in line 6"),
    ('Printf("x") > "CANARY";', "Printf in line 6"),
    ('Printf("x") >> "CANARY";', "Printf in line 6"),
    ('Save "CANARY.msh";', "Save in line 6"),
    ('Merge "evil.inc";', "Merge in line 6"),
    ('Include "evil.inc";', "Include in line 6"),
    ("Plugin(Triangulate).Run;", "Plugin in line 6"),
    ("Exit;", "Exit in line 6"),
    ('Printf(Sprintf("x")) >> "CANARY";', "Printf in line 6"),
    ('Printf("x"', "Printf in line 6"),
    ('SystemCall Printf("x"); %s;', "SystemCall in line 6"),
    ("Macro Evil\nSystemCall %s;\nReturn\nCall Evil;", "SystemCall in line 7"),
    ("Macro SystemCall\nx = 1;\nReturn\nSystemCall %s;", "SystemCall in line 9"),
    ("Macro Evil\nxReturn = 1;\nReturn", "xReturn in line 7"),
    ("Call Evil;", "Evil in line 6"),
    ("x = Call;", "Call in line 6"),
    ("s = Sprintf(%s);", "the text"),
    ("s = Sprintf(Str(%s));", "Sprintf in line 6"),
    ('Physical Point(Sprintf("%d", 1)) = {1};', "the text"),
    ('Physical Point(Sprintf("%300g", 1)) = {1};', "the text"),
    ('Physical Point(Sprintf("%.99g", 1)) = {1};', "the text"),
    ('Physical Point("it\'s") = {1};', "the text"),
    ('Hide "CANARY";', "the text"),
    ("For i In {1:1}\nSystemCall %s;\nEndFor", "SystemCall in line 7"),
    ("Field[1] = ExternalProcess;\nField[1].CommandLine = %s;", "ExternalProcess in line 6"),
    ("Field[1] = Min;\nField[1].CommandLine = %s;", "the text"),
    ('Field[1] = Structured;\nField[1].FileName = "CANARY";', "Structured in line 6"),
    ("ExternalProcess = 1;\nField[1] = ExternalProcess;", "ExternalProcess in line 7"),
    ('General.ErrorFileName = "CANARY";', "General in line 6"),
    ('Print.ParameterCommand = "SystemCall";', "Print in line 6"),
    ("Mesh.MaxNumThreads2D = 1e6;", "Mesh.MaxNumThreads2D in line 6"),
    ('Mesh.MeshSizeMax = "CANARY";', "the text"),
    ('Geometry.OCCTargetUnit = "M";', "the text"),
    ('DefineConstant[ s = {%s, Name "s"} ];\nSystemCall s;', "the text"),
    ('DefineConstant[ a = {1, Name "a", ServerAction %s} ];', "ServerAction in line 6"),
    ('DefineConstant[ a = {1, Macro "Gmsh"} ];', "Macro in line 6"),
    ('DefineConstant[ a = {1, GmshOption "General.Terminal"} ];', "GmshOption in line 6"),
    ("s = Str(%s);\nSystemCall s;", "Str in line 6"),
    ("s = %s;", "the text"),
    ("SystemCall = 1;\nSystemCall %s;", "SystemCall in line 7"),
    ("Physical Surface(Str(%s)) = {1};", "Str in line 6"),
    ('SetFactory("Merge");', "the text"),
    ('x = GetEnv("HOME");', "GetEnv in line 6"),
    # comments and texts that Gmsh's own reader ends elsewhere
    ("/* // */ SystemCall %s;", "SystemCall in line 6"),
    ("/* * **/ SystemCall %s; /**/", "SystemCall in line 6"),
    ("// \rSystemCall %s;", "SystemCall in line"),
    ("// \0SystemCall %s;", "the control character '\\x00' in line 6"),
    ("/* \0SystemCall %s; */", "the control character '\\x00' in line 6"),
    (f"Physical Surface(\"{LONG} SystemCall 'touch CANARY';\") = {{1}};", "in line 6"),
    ('Physical Surface("a\nSystemCall %s;") = {1};', "in line 6"),
    ('If (0)\nPhysical Point("EndIf Merge") = {1};\nEndIf', "the text"),
    ("/* SystemCall", "SystemCall in line 6"),
    ("For SystemCall In {1:2}\nSystemCall %s;\nEndFor", "SystemCall in line 7"),
    ("EndFor i In {1:2}", "i in line 6"),
]
HARMLESS = [  # attacks that end with the comments, or that Gmsh answers with an error
    '// SystemCall "touch CANARY";',
    '/* SystemCall "touch CANARY"; */',
    'If (0)\n// EndIf SystemCall "touch CANARY";\nEndIf',
    'For i In {1:0}\n/* EndFor SystemCall "touch CANARY"; */ x = 1;\nEndFor',
    "SystemCall = 1;",
]
WORKING = ["SystemCall %s;", 'Printf("x") > "CANARY";', "// \0SystemCall %s;"]
ORDINARY = {
    "fields": """
        Field[1] = Distance; Field[1].CurvesList = {1, 2}; Field[1].Sampling = 100;
        Field[2] = Threshold; Field[2].InField = 1; Field[2].SizeMin = h / 4;
        Field[2].SizeMax = h; Field[2].DistMin = 0.1; Field[2].DistMax = 0.5;
        Field[3] = MathEval; Field[3].F = "0.1 + 0.2 * x"; Field[4] = Min;
        Field[4].FieldsList = {2, 3}; Background Field = 4;
        Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0;""",
    "sizes": """
        MeshSize{ 1, 2 } = 0.1; Characteristic Length {3} = 0.2; Mesh.Algorithm = 5;
        Mesh.CharacteristicLengthMax = 0.3; Mesh.MshFileVersion = 2.2;
        Geometry.Tolerance = 1e-6;""",
    "groups": """
        Physical Surface('cloth', 7) = {1}; Physical Curve("hem") = {1};
        Physical Curve("hem") += {3};
        Physical Point("corners") = {1, 2, 3:4}; Physical Line(12) = {2};""",
    "loops": """
        n[] = {}; For i In {0:2}
          p~{i} = newp; Point(p~{i}) = {0.2 + 0.2 * i, 0.5, 0, h}; n[] += p~{i};
          Point{p~{i}} In Surface{1};
        EndFor
        If (#n[] > 2 && n[0] != 0) Printed = 1; ElseIf (h >= 1) Printed = 2; Else Printed = 3; EndIf
        For (1:3:2) For (1:#n[]) Printed++; EndFor EndFor""",
    "constants": """
        DefineConstant[ k = {3, Min 1, Max 9, Step 1, Name "Parameters/Number"},
          kind = {1, Choices{1="fine", 2="coarse"}, Name "Parameters/Kind", Visible 0} ];
        m = DefineNumber[ 0.1, Name "Parameters/m" ]; area = k > 2 ? Sqrt(m) : Hypot(m, k);""",
    "curves": """
        Point(11) = {0.3, 0.3, 0, h}; Point(12) = {0.7, 0.3, 0, h}; Point(13) = {0.5, 0.6, 0, h};
        Spline(11) = {11, 12, 13}; BSpline(12) = {13, 11}; Line(13) = {11, 12};
        Curve{13} In Surface{1}; Transfinite Curve {1, 3} = 5 Using Progression 1.1;
        Delete { Curve{11, 12}; } Coherence;""",
    "terminal": """
        Printf("New curves '%g' and %g; For the last time", 1, 2);
        If (h < 1) Printf(Sprintf("h = %g", h)); EndIf""",
    "macros": """
        Macro Spot
          p1 = newp; Point(p1) = {x, y, 0, h / 4}; Point{p1} In Surface{1}; k = k + 1;
          Physical Point(Sprintf("hole %g", k)) = {p1};
        Return
        Function Unused
          y = y + k;
        Return
        k = 0; x = 0.3; y = 0.4;
        Call Spot;
        x = 0.7;
        Call Spot;
        Call Unused;""",
    "ranges": """
        n[] = {1 ... 4}; Physical Curve("rim") = {n[]}; Physical Point("p") = {1 ... 4};
        Hide {:} Show { Surface{1}; } Hide "*";
        b[] = BoundingBox Surface{1}; q[] = Point In BoundingBox {-1, -1, -1, 0.5, 2, 1};
        Physical Point("left") = {q[]};""",
    "formulas": """
        Field[1] = MathEval; Field[1].F = Sprintf("0.2 + %g * x", h); Background Field = 1;""",
    "extrusion": 'out[] = Extrude {0, -1, 0} { Curve{-1}; }; Physical Surface("skirt") = {out[1]};',
}
OCC = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1, 0.1}; Disk(2) = {0.5, 0.5, 0, 0.2, 0.1};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
edges() = Boundary{ Surface{3}; }; Physical Curve("rim") = {edges()};
Rotate {{0, 0, 1}, {0, 0, 0}, Pi / 4} { Surface{3}; }
MeshSize { PointsOf{ Surface{3}; } } = 0.2;
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder: Path, text: str, name: str = "evil.geo") -> Path:
    path = folder / name
    path.write_bytes(text.replace("%s", TOUCH).encode())
    return path


def made(folder: Path) -> list[str]:
    """The files that an attack has made, after time for a process that it may have started."""
    return [file.name for file in folder.rglob("*CANARY*")]


# --- attacks --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lines", "name"), EVIL)
def test_a_command_outside_the_list_is_refused_before_gmsh_starts(folder, monkeypatch, lines, name):
    monkeypatch.setattr(reading, "in_child", lambda *_: pytest.fail("Gmsh was started"))
    path = written(folder, SQUARE + lines + "\n")
    with pytest.raises(MeshError, match="pass --trust-geo, or trust=True") as caught:
        read(path)
    assert name in str(caught.value)
    assert "evil.geo" in str(caught.value)
    assert made(folder) == []


@pytest.mark.stories
@pytest.mark.parametrize("lines", HARMLESS + WORKING)
def test_parts_of_an_attack_leave_files_of_those_who_trust_only(folder, lines):
    """The attacks in WORKING leave a file: so the test would see a file of the others, too."""
    path = written(folder, SQUARE + lines + "\n")
    trust = lines in WORKING
    with suppress(MeshError):
        assert len(read(path, trust=trust).triangles) > 4
    assert made(folder) == ["CANARY"] * trust


@pytest.mark.stories
@pytest.mark.parametrize("command", ["info", "run", "check", "mesh"])
def test_every_command_that_meshes_refuses(folder, capsys, command):
    written(folder, SQUARE + "SystemCall %s;\n")
    (folder / "evil.toml").write_text(
        '[cloth]\nshape = "file"\npath = "evil.geo"\n[fabric]\nareal_density = 0.2\n'
        'tensile_stiffness = 500.0\n[[terms]]\ntype = "StVK"\n[time]\nmethod = "bdf2"\n'
        "dt = 0.01\nt_end = 0.02\n[expect]\nsag = { value = 0, absolute = 1 }\n"
    )
    for scene in ("evil.toml", *(["evil.geo"] if command == "mesh" else [])):
        assert main([command, scene]) == 2
        assert "SystemCall in line 6" in capsys.readouterr().err
    assert made(folder) == []
    assert main([command, "evil.toml", "--trust-geo"]) == 0
    assert made(folder) == ["CANARY"]


@pytest.mark.parametrize("text", stories_except(["", " \n", "\n", "\ufeff"], "", "\ufeff"))
def test_a_mesh_file_of_commands_is_refused(folder, text):
    """Gmsh reads any file that does not begin with $MeshFormat as commands."""
    mesh = text + "$MeshFormat\n2.2 0 8\n" if text else ""
    path = written(folder, mesh + "SystemCall %s;\n", "evil.msh")
    with pytest.raises(MeshError, match=r"must begin with \$MeshFormat"):
        read(path)
    assert made(folder) == []


@pytest.mark.stories
def test_options_beside_a_file_are_not_read(folder):
    """Gmsh merges x.msh.opt after x.msh, and x.geo.opt after x.geo."""
    (folder / "a.msh").write_bytes((ROOT / "meshes" / "square_22.msh").read_bytes())
    written(folder, "SystemCall %s;\n", "a.msh.opt")
    written(folder, SQUARE, "a.geo")
    written(folder, "SystemCall %s;\n", "a.geo.opt")
    for name in ("a.msh", "a.geo"):
        assert len(read(folder / name).triangles) > 4
    assert made(folder) == []


@pytest.mark.parametrize(
    "name",
    stories_except(["evil.geo_unrolled", "evil.brep", "evil.pos", "evil.opt", "evil"], "evil.opt"),
)
def test_other_files_of_gmsh_are_refused(folder, name):
    with pytest.raises(MeshError, match="unknown suffix"):
        read(written(folder, SQUARE + "SystemCall %s;\n", name))
    assert made(folder) == []


def test_a_module_in_the_current_folder_is_not_imported(folder):
    for name in ("gmsh", "numpy", "json", "fecloth"):
        (folder / f"{name}.py").write_text("open('CANARY', 'w')\n")
    read(written(folder, SQUARE, "plain.geo"))
    assert made(folder) == []


# --- ordinary files -------------------------------------------------------------------------------


@pytest.mark.parametrize("path", GEO_FILES, ids=lambda path: path.stem)
def test_the_files_of_the_project_are_allowed(path):
    assert len(GEO_FILES) > 6
    check_geo(path.read_text(), str(path))


@pytest.mark.stories
@pytest.mark.parametrize("text", ORDINARY.values(), ids=ORDINARY)
def test_ordinary_files_are_allowed_and_meshed_as_they_are(folder, text):
    path = written(folder, SQUARE + text + "\n", "plain.geo")
    checked, trusted = read(path), read(path, trust=True)
    assert np.array_equal(checked.X, trusted.X)
    assert np.array_equal(checked.triangles, trusted.triangles)
    assert checked.node_sets.keys() == trusted.node_sets.keys()


def test_macros_and_sprintf_make_the_groups_that_they_name(folder):
    mesh = read(written(folder, SQUARE + ORDINARY["macros"] + "\n", "plain.geo"))
    holes = [mesh.X[mesh.node_sets[f"hole {k}"]].tolist() for k in (1, 2)]
    assert holes == [[[0.3, 0.4]], [[0.7, 0.4]]]
    mesh = read(written(folder, SQUARE + ORDINARY["ranges"] + "\n", "plain.geo"))
    assert mesh.X[mesh.node_sets["left"]].tolist() in ([[0, 0], [0, 1]], [[0, 1], [0, 0]])
    assert len(mesh.node_sets["p"]) == 4


@pytest.mark.stories
def test_the_other_kernel(folder):
    mesh = read(written(folder, OCC, "plain.geo"))
    assert len(mesh.triangles) > 50
    assert "rim" in mesh.edge_sets


# --- limits ---------------------------------------------------------------------------------------

FINE = SQUARE.replace("h = 0.5", "h = 3e-4")  # some 25 million triangles


@pytest.mark.stories
def test_meshing_ends_at_the_limit_of_time(folder):
    path = written(folder, FINE, "fine.geo")
    with pytest.raises(MeshError, match="meshing or reading takes longer: must end within 2 s"):
        read(path, time_limit=2.0)
    with pytest.raises(InputError, match="time_limit = 0"):
        read(path, time_limit=0)
    assert main(["mesh", str(path), "--mesh-time", "1"]) == 2


def children(pid: int) -> list[int]:
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(word) for word in text.split()]


def is_running(pid: int) -> bool:
    """Whether a process runs; one that has ended may wait for its parent as a zombie."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def stopped(path: Path, number: int) -> int:
    """Send a signal once the child meshes; neither process may live on for long.

    A test run that ignores the signal, as under nohup, must not hand that on.
    """
    handlers = (
        {}
        if number == signal.SIGKILL
        else {"preexec_fn": lambda: signal.signal(number, signal.SIG_DFL)}
    )
    command = [sys.executable, "-m", "fecloth", "mesh", str(path)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, **handlers)
    while not (pids := children(process.pid)):
        assert process.poll() is None
        time.sleep(0.02)
    time.sleep(1.0)
    process.send_signal(number)
    status = process.wait()
    time.sleep(0.5)
    assert not is_running(pids[0])
    return status


@pytest.mark.stories
@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux tells a process of its parent's end"
)
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 4), (signal.SIGKILL, -9)])
def test_a_signal_ends_meshing_at_once(folder, number, status):
    """And the child ends with a killed parent."""
    assert stopped(written(folder, FINE, "fine.geo"), number) == status


@pytest.mark.stories
def test_a_crash_of_gmsh_is_an_error(folder, monkeypatch):
    monkeypatch.setattr(child_process.sys, "executable", "/bin/false")
    with pytest.raises(MeshError, match="reading has ended without a mesh"):
        read(written(folder, SQUARE, "plain.geo"))


def test_a_confined_child_writes_no_file(folder):
    """The second wall: even a command that the check overlooked would find its file empty."""
    written(folder, SQUARE + 'Printf("x") > "CANARY";\n')
    task = {"geo": str(folder / "evil.geo"), "h": None, "confined": True}
    child_process.in_child(task, "evil.geo")
    assert not any(os.path.getsize(folder / name) for name in made(folder))


def test_a_file_of_more_characters_than_allowed_is_refused(monkeypatch):
    text = "Point(1) = {0, 0, 0};"
    monkeypatch.setattr(geo_commands, "MOST_CHARACTERS", len(text))
    check_geo(text, "a.geo")
    with pytest.raises(MeshError, match="22 characters: must be at most 21"):
        check_geo(text + " ", "a.geo")
