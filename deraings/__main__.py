"""deraings reconstruct: a scene from your own rainy photographs."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import tyro

from deraings.reconstruct import Reconstruction, reconstruct
from hydroviews.cli.commands import run_command


def reconstruct_command(request: tyro.conf.OmitArgPrefixes[Reconstruction]) -> None:
    """Reconstruct a clean 3D scene from rainy photographs or a rainy video: cameras, splats.ply, film, pictures."""
    reconstruct(request)


def main() -> None:
    """Entry point."""
    run_command({"reconstruct": reconstruct_command}, prog="deraings")


if __name__ == "__main__":
    main()
