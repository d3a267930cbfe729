"""python -m benchmarks NAME [options]: speed against error, one benchmark at a time."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import ast
import importlib
import sys
from pathlib import Path

from hydroviews.cli.commands import run_command

BENCHMARKS = {  # modules by name
    "splatting": "splatting.steps",
    "against": "splatting.against",
    "gpu": "splatting.gpu",
    "busy_machine": "busy_machine",
    "volumetric": "volumetric",
    "quality": "quality",
    "methods": "methods",
    "enhancement": "enhancement",
    "families": "families",
    "dataset": "dataset",
    "poses": "poses",
    "raindrops": "rain.raindrops",
    "renewed_drops": "rain.renewed_drops",
    "streaks": "rain.streaks",
    "window_look": "rain.window_look",
    "windows": "rain.windows",
    "hard_rain": "rain.hard_rain",
    "hard_poses": "rain.hard_poses",
}


def listing() -> str:
    """A line for each benchmark: its name and the first line of its documentation."""
    width = max(map(len, BENCHMARKS))
    return "\n".join(f"  {name:{width}}  {_first_line(module)}" for name, module in BENCHMARKS.items())


def _first_line(module: str) -> str:
    """Read, not imported: most benchmarks take seconds to import."""
    path = Path(__file__).parent.joinpath(*module.split(".")).with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text())) or "").split("\n")[0]


def main() -> None:
    """Run the benchmark that the first argument names; list all of them where it names none."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in BENCHMARKS:
        asked = name in ("-h", "--help")
        text = f"usage: python -m benchmarks NAME [options]; --help after NAME explains the options\n\n{listing()}"
        print(text if asked else f"error: {name}: no such benchmark\n{text}", file=sys.stdout if asked else sys.stderr)
        sys.exit(0 if asked else 2)
    module = importlib.import_module(f"benchmarks.{BENCHMARKS[name]}")
    sys.argv[1:] = arguments
    run_command(module.main, prog=f"benchmarks {name}")


if __name__ == "__main__":
    main()
