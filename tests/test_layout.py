"""The layout: which module may import which, how many entries a folder has, and the tree in CONTRIBUTING.md."""

import ast
import re
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parent.parent
PACKAGES = ("hydroviews", "baselines", "deraings", "leaderboard")  # each may import those before it
# The parts of hydroviews, each may import those before it.
PARTS = (
    ("errors",),
    ("files",),
    ("cli",),
    ("profiles", "scene", "metrics"),
    ("formats",),
    ("captures", "blender"),
    ("rain",),
    ("pairs",),
    ("dataset",),
    ("torch",),
    ("__main__",),
)
BPY = ("bpy", "bmesh", "mathutils")
DOZEN = 12
UNCOUNTED = ("__init__.py", "__main__.py", "torch.py")  # doors: what people import or run by the package's name


@cache
def modules() -> dict[str, Path]:
    """The files of all packages by their modules' names."""
    files = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return {module_name(path.relative_to(ROOT)): path for path in files}


def module_name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(source: str, known) -> set[str]:
    """What a module's source imports anywhere in it: the submodule where a name is one, else the module itself."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports name their module in full"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else str(node.module) for name in inner}
    return names


@cache
def imports() -> dict[str, set[str]]:
    """What each module imports, from our packages or from others."""
    return {name: imported(path.read_text(), modules()) - {name} for name, path in modules().items()}


def part(module: str) -> int:
    """The place of a module of hydroviews in PARTS."""
    return next(i for i, part in enumerate(PARTS) if module.split(".")[1] in part)


def tree(text: str) -> set[PurePosixPath]:
    """The paths that the block "text tree" of a page names: one a line, two blanks deeper below its folder."""
    found = re.search(r"^```text tree\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert found, "no block ```text tree"
    paths, above = set(), [PurePosixPath()]
    for line in found[1].splitlines():
        depth, name = (len(line) - len(line.lstrip())) // 2, line.split()[0]
        above = [*above[: depth + 1], above[depth] / name]
        paths.add(above[-1])
    return paths


def test_no_modules_import_each_other():
    TopologicalSorter({name: names & modules().keys() for name, names in imports().items()}).prepare()  # or CycleError


def test_packages_and_parts_of_hydroviews_import_only_those_before_them():
    order = {package: i for i, package in enumerate(PACKAGES)}
    edges = [(module, name) for module, names in imports().items() for name in names]
    packages = [(module.split(".")[0], name.split(".")[0], module, name) for module, name in edges]
    assert [edge for edge in packages if order.get(edge[1], -1) > order[edge[0]]] == []
    inside = [edge for edge in edges if all(end.startswith("hydroviews.") for end in edge)]
    between = [(module, name) for module, name in inside if module.split(".")[1] != name.split(".")[1]]
    assert [(module, name) for module, name in between if part(name) >= part(module)] == []


OTHER_MAKE = "hydroviews.rain.other_make"  # rain that no method may know of: it tells a result from an adaptation


def closure(reached: set[str], graph: dict[str, set[str]]) -> set[str]:
    """Modules and all that lead on from them in a graph, directly or through others."""
    while more := {found for name in reached for found in graph.get(name, ())} - reached:
        reached = reached | more
    return reached


def test_no_method_and_no_training_knows_the_other_make():
    """Neither by imports nor by name, nor by raining with whatever effects there are."""
    own = {name for name in modules() if name.startswith(("deraings.", "baselines.", "hydroviews.pairs."))}
    known = closure(own, imports())
    assert "hydroviews.rain.lens.patterns.pattern" in known
    assert {name for name in known if name.startswith(OTHER_MAKE)} == set()
    telling = ("raindrop-b", "streak-b", "registered_effects", "pattern_names", "other_make")
    assert {name: word for name in own for word in telling if word in modules()[name].read_text()} == {}


def test_the_rain_model_and_the_masks_share_no_rule_with_the_generator():
    """Training of the enhancement network draws rain itself, and is the one place where both meet."""
    own = [names for name, names in imports().items() if name.startswith(("deraings.rain_model", "deraings.masks"))]
    assert own
    assert {name for names in own for name in names if name.startswith("hydroviews.rain")} == set()


def test_the_other_make_shares_no_drawing_with_the_first():
    own = [names for module, names in imports().items() if module.startswith(OTHER_MAKE)]
    assert own
    first = ("hydroviews.rain.lens", "hydroviews.rain.streaks", "hydroviews.rain.light", "hydroviews.blender")
    assert {name for names in own for name in names if name.startswith(first)} == set()


def test_only_processes_of_blender_import_bpy():
    """Directly or through another module: everything else works without Blender."""
    importing: dict[str, set[str]] = {}
    for module, names in imports().items():
        for name in names:
            importing.setdefault(name, set()).add(module)
    roots = {name for name in importing if name.split(".")[0] in BPY}
    assert roots
    reached = closure(roots, importing) - roots
    assert {module for module in reached if not module.startswith("hydroviews.blender.")} == set()


CROWDED = {  # folders that may have more than a dozen files, and why
    "hydroviews/scene": "the paths are part of the digest that marks built data sets",
    "hydroviews/blender/embedded_scenes": "the same",
}


def test_a_folder_has_at_most_a_dozen_files():
    tops = ("hydroviews", "baselines", "deraings", "leaderboard", "benchmarks", "examples", "docs", "tests")
    files = [path for top in tops for path in (ROOT / top).rglob("*.py") if path.name not in UNCOUNTED]
    counts = Counter(str(path.parent.relative_to(ROOT)) for path in files)
    assert sorted(folder for folder, count in counts.items() if count > DOZEN and folder not in CROWDED) == []
    for root in ("hydroviews", "deraings", "leaderboard", "baselines/splatting"):  # whose folders count as well
        entries = [path for path in (ROOT / root).iterdir() if path.suffix == ".py" or next(path.rglob("*.py"), None)]
        assert len([path for path in entries if path.name not in UNCOUNTED]) <= DOZEN, root


def test_inside_splatting_no_folder_imports_one_that_imports_it():
    """A file of the root counts as a folder of its own."""
    inside = {name: names for name, names in imports().items() if name.startswith("baselines.splatting.")}
    graph: dict[str, set[str]] = {}
    for name, names in inside.items():
        graph.setdefault(name.split(".")[2], set()).update(other.split(".")[2] for other in names & inside.keys())
    assert len(graph) > 10
    TopologicalSorter({part: parts - {part} for part, parts in graph.items()}).prepare()  # or CycleError


def test_the_tree_in_contributing_is_the_tree_on_disk():
    named = tree((ROOT / "CONTRIBUTING.md").read_text())
    assert [str(path) for path in sorted(named) if not (ROOT / path).exists()] == []
    folders = {PurePosixPath(path.parent.relative_to(ROOT)) for path in modules().values()}
    assert [str(folder) for folder in sorted(folders - named) if len(folder.parts) <= 3] == []


def test_the_list_of_helpers_names_them_all():
    helpers = ROOT / "tests/helpers"
    listed = re.findall(r"^\| `(\w+\.py)` \|", (helpers / "README.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(path.name for path in helpers.glob("*/*.py"))
