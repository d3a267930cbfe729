"""What is shipped: a wheel has every file that the program reads, and says of itself what is so."""

import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import hydroviews

REPOSITORY = Path(__file__).parents[1]
PACKAGES = ("hydroviews", "baselines", "deraings", "leaderboard")
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())


def files(package: str) -> list[Path]:
    found = (REPOSITORY / package).rglob("*")
    return [path for path in found if path.is_file() and "__pycache__" not in path.parts]


def shipped(path: Path, patterns: dict[str, list[str]]) -> bool:
    """Whether a pattern of the package data that holds for one of the folders above reaches the file."""
    for folder in path.parents:
        if (folder / "__init__.py").exists():
            package = ".".join(folder.relative_to(REPOSITORY).parts)
            for pattern in [*patterns.get(package, []), *patterns["*"]]:
                if fnmatch(str(path.relative_to(folder)), pattern):
                    return True
    return False


def test_a_wheel_has_every_file_that_is_no_code():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]
    data = [path for package in PACKAGES for path in files(package) if path.suffix != ".py"]
    assert {path.suffix for path in data} >= {".toml", ".json", ".safetensors", ".typed"}
    assert [str(path) for path in data if not shipped(path, patterns)] == []
    assert not shipped(REPOSITORY / "hydroviews/captures/notes.txt", patterns)


def test_a_wheel_has_every_package():
    assert PROJECT["tool"]["setuptools"]["packages"]["find"]["include"] == [f"{name}*" for name in PACKAGES]
    code = [path for package in PACKAGES for path in files(package) if path.suffix == ".py"]
    assert [str(path) for path in code if not (path.parent / "__init__.py").exists()] == []


def test_one_version_everywhere():
    citation = (REPOSITORY / "CITATION.cff").read_text()
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == hydroviews.__version__
    assert f"\n## {hydroviews.__version__} - " in (REPOSITORY / "CHANGELOG.md").read_text()


def test_constraints_pin_every_dependency():
    constraints = (REPOSITORY / "constraints.txt").read_text()
    pinned = {re.sub(r"[-_.]+", "-", name).lower() for name in re.findall(r"^([\w.-]+)==", constraints, re.MULTILINE)}
    project = PROJECT["project"]
    asked = [*project["dependencies"], *(one for extra in project["optional-dependencies"].values() for one in extra)]
    names = {re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower() for requirement in asked}
    assert sorted(names - pinned) == []
