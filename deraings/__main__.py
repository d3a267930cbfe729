"""deraings reconstruct: a scene from one's own rainy photographs."""

import signal

if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # no traceback of the imports; `run_command` takes over

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
