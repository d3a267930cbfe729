"""One's own rainy photographs, or a film, to a clean 3D scene: cameras, training, a splat file, a film, pictures."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import tyro

from baselines.gaussian_splatting import SPLATS
from baselines.method import Method, find_method
from hydroviews.claims import claim
from hydroviews.errors import InputError
from hydroviews.frames import FrameChoice
from hydroviews.images import write_png
from hydroviews.poses import estimate_poses
from hydroviews.profiles import find_profile
from hydroviews.readers import has_cameras, read_scene
from hydroviews.readers.photographs import photographs_below
from hydroviews.scenes import Scene, Split
from hydroviews.sheet import spread
from hydroviews.tiles import Canvas, Row, Tile, draw_sheet
from hydroviews.video import capture_video
from leaderboard.film import FilmChoice, draw_film

CAPTURE, TRAINING, FILM, SHEET, SETTINGS = "capture", "training", "film.mp4", "views.png", "reconstruction.json"
SHOWN = 4  # photographs on the sheet
SHEET_WIDTH = 1600  # pixels


@dataclass(frozen=True)
class Reconstruction:
    """What to reconstruct, and how."""

    photographs: tyro.conf.Positional[Path]  # folder of photographs, capture with cameras, or film
    out: Path | None = None  # `<photographs>-scene` beside it if not given
    method: str = "deraings-plus"  # any method of the benchmark that learns from rainy views
    profile: str = "quick"  # how large pictures are and how long it trains: demo, quick or paper
    long_side: int | None = None  # pixels of the pictures' longer side, instead of the profile's
    rate: float = 1.0  # frames a second that are taken of a film
    seed: int = 0
    film: FilmChoice = field(default_factory=FilmChoice)

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        path = self.photographs.resolve()
        return self.out or path.with_name(path.stem + "-scene")


def reconstruct(request: Reconstruction) -> Path:
    """Photographs to a scene; what is finished is kept, so that the same call goes on after an interruption.

    All photographs are learned from, none is held out. The folder gets `capture` (photographs and cameras, unless
    they came with cameras), `training` (the model, and `splats.ply` where it is one of Gaussians), `views.png`
    (photographs beside renders) and `film.mp4`.

    Returns:
        The folder.

    Raises:
        InputError: nothing to reconstruct from, too few photographs register, an unknown method, or the folder holds
            a reconstruction with other settings.
    """
    require_photographs(request.photographs)
    folder, kind = request.folder, find_method(request.method)
    if kind.trains_on != "rainy":
        raise InputError(f"--method {request.method}: learns from clean views, and here are none", fix="choose another")
    settings = asdict(request) | {"photographs": str(request.photographs.resolve()), "out": str(folder.resolve())}
    claim(
        folder / SETTINGS,
        settings,
        taken="holds a reconstruction with other settings",
        foreign="holds other files",
        fix="choose another --out, or remove the folder",
        ignored=("film",),
    )
    scene = find_scene(request, folder / CAPTURE)
    for note in scene.notes:
        print(note)
    scene = all_views(scene.resized(request.long_side or find_profile(request.profile).long_side))
    method = kind(kind.configuration(request.profile), request.seed)
    method.fit(scene, folder / TRAINING)
    method.save(folder / TRAINING)
    write_png(folder / SHEET, compared(method, scene, request.photographs.resolve().stem))
    draw_film(method, scene, folder / FILM, request.film, {"scene": settings})
    print(f"found in the photographs: {method.statistics().used or 'nothing was looked for'}")
    splats = (folder / TRAINING / SPLATS).is_file()  # methods without Gaussians write none
    model = f"{TRAINING}/{SPLATS} for splat viewers" if splats else f"the model in {TRAINING}"
    print(f"{folder}: {model}, {FILM}, {SHEET}")
    return folder


def require_photographs(path: Path) -> None:
    """Refuse what is no film and holds no photographs, before a folder is made for it.

    Raises:
        InputError: so it is.
    """
    if path.is_file() or (path.is_dir() and (has_cameras(path) or photographs_below(path))):
        return
    raise InputError(
        f"{path}: nothing to reconstruct from",
        found="no photographs in it" if path.is_dir() else "no such file or folder",
        expected="a folder of photographs, a capture with cameras, or a film",
    )


def find_scene(request: Reconstruction, capture: Path) -> Scene:
    """The photographs with cameras, estimated into `capture` if they have none.

    Raises:
        InputError: too few photographs register, or a film or camera file that cannot be read.
    """
    path = request.photographs
    if path.is_file():
        scene = capture_video(path, capture, FrameChoice(request.rate), seed=request.seed)
        assert scene is not None  # it stops before cameras only when asked to
        return scene
    if has_cameras(path):
        return read_scene(path)
    return estimate_poses(path, capture, seed=request.seed, rainy=True)


def all_views(scene: Scene) -> Scene:
    """The scene with nothing held out: whoever wants the scene wants all of their photographs in it."""
    names = tuple(view.name for view in scene.views)
    return replace(scene, split=Split(names, (), scene.split.sparse))


def compared(method: Method, scene: Scene, title: str) -> Canvas:
    """A sheet of a few photographs, each above what the scene looks like from there."""
    names = spread([view.name for view in scene.views], SHOWN)
    views = [view for view in scene.views if view.name in set(names)]
    rows = [
        Row("photographs", "", [Tile(view.image(), view.name) for view in views]),
        Row("the scene", "from the same places", [Tile(method.render(view.camera)) for view in views]),
    ]
    return draw_sheet(title, f"{len(scene.views)} photographs", rows, SHEET_WIDTH)
