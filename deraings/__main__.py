"""deraings reconstruct: a scene from one's own rainy photographs."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

import tyro

from deraings.reconstruct import Reconstruction, reconstruct
from hydroviews.cli.commands import run_command


def reconstruct_command(request: tyro.conf.OmitArgPrefixes[Reconstruction]) -> None:
    """Photographs or a film taken in rain to a clean 3D scene: cameras, training, splats.ply, film, pictures."""
    reconstruct(request)


def main() -> None:
    """Entry point."""
    run_command({"reconstruct": reconstruct_command}, prog="deraings")


if __name__ == "__main__":
    main()
