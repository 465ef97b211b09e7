"""The floors: a file imports only from floors below; rooms on one floor do not know each other."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "torchliner"
FLOORS = {
    "names": 0,
    "checks": 0.5,
    "units": 0.5,
    "file_checks": 1.5,
    "fluid": 1,
    "conversions": 1,
    "text_columns": 2,
    "records": 3,
    "liners": 4,
    "engine": 5,
    "duct": 5.5,
    "pressure": 5.8,
    "io": 6,
    "velocity": 7,
    "studies": 8,
    "bursts": 8,
    "report": 9,
    "campaign": 9.2,
    "cli": 10,
    "__main__": 11,
}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p.name != "__init__.py")


def rooms_of(node: ast.AST) -> list[str]:
    """Rooms that an import statement leads to; "__init__" where it is the package's face."""
    if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("torchliner"):
        return []
    inside = node.module.split(".")[1:2] or [each.name for each in node.names]
    return [name if name in FLOORS else "__init__" for name in inside]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path):
    """Every import of the package's own names leads to a lower floor or to the same room."""
    here = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for there in [each for node in ast.walk(tree) for each in rooms_of(node)]:
        assert there == here or FLOORS.get(there, 99) < FLOORS[here], f"{here} imports {there}"


def test_every_room_has_a_floor():
    """No room without a place in the table."""
    rooms = {p.relative_to(PACKAGE).parts[0].removesuffix(".py") for p in MODULES}
    assert rooms == set(FLOORS)


def test_no_circles():
    """No file imports itself through others, late imports and those for types included."""
    names = {".".join(("torchliner", *p.relative_to(PACKAGE).with_suffix("").parts)): p for p in PACKAGE.rglob("*.py")}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    below = {name: imported(path, names) - {name} for name, path in names.items()}
    while ground := {name for name, needs in below.items() if not needs}:
        below = {name: needs - ground for name, needs in below.items() if name not in ground}
    assert not below, f"these import each other in a circle, or stand above one: {sorted(below)}"


def imported(path, names):
    """The package's modules that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module in names:
            parts = {f"{node.module}.{each.name}" for each in node.names}
            found |= (parts & set(names)) or {node.module}
    return found


def test_every_outlet_leads_somewhere():
    """A record names its file and its figure: something that writes, something that takes it."""
    from torchliner import records
    from torchliner.names import resolve
    from torchliner.records.outlets import Drawn, Reported, Written

    kinds = [each for each in vars(records).values() if inspect.isclass(each)]
    assert callable(resolve(Reported.PAGE))
    assert sum(issubclass(each, Written) for each in kinds) == 9
    for kind in kinds:
        if issubclass(kind, Written):
            assert callable(resolve(kind.FILE))
        if issubclass(kind, Drawn):
            assert kind.__name__ in str(
                next(iter(inspect.signature(resolve(kind.PLOT)).parameters.values())).annotation
            )


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import torchliner", ["matplotlib", "dask", "torch", "xarray", "scipy"]),
        ("import torchliner; torchliner.educe", ["matplotlib", "dask", "xarray", "sympy", "torch._dynamo"]),
        ("from torchliner.cli.main import overview; overview()", ["torch", "numpy", "h5py"]),
    ],
)
def test_imports_stay_light(code, absent):
    """What a user does not use is not imported."""
    check = f"{code}\nimport sys\nprint([m for m in {absent!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True).stdout
    assert found.strip() == "[]"


def test_names_are_those_of_the_code():
    """The tables of names and those of the code have the same keys."""
    from torchliner import names
    from torchliner.liners.model import LinerModel
    from torchliner.velocity.averages import PHASE_RULES

    assert set(names.PHASES) == set(PHASE_RULES) > set(names.UNHEARD)
    for name, home in names.LINER_MODELS.items():
        assert issubclass(kind := names.resolve(home), LinerModel)
        assert kind.model == name


def test_public_names_exist():
    """Every name in __all__ can be had, and an unknown one is an AttributeError."""
    import torchliner as tl

    assert all(getattr(tl, name) is not None for name in tl.__all__)
    # A room of that name would take the place of the function once it is imported.
    assert not set(tl.__all__) & set(FLOORS)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = tl.nothing


def test_files_are_one_idea():
    """A file over 300 lines wants a reason."""
    long = {
        str(p.relative_to(PACKAGE)): n for p in MODULES if (n := len(p.read_text(encoding="utf-8").splitlines())) > 330
    }
    assert long == {}
