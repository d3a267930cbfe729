"""Paired captures as scenes: trained on in rain, scored on clean photographs (see `paired_pictures`)."""

import filecmp
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hydroviews.errors import InputError
from hydroviews.formats.paired.pictures import Pictures
from hydroviews.formats.photographs import SPLIT, some, view_names
from hydroviews.scene.cameras import same_shape
from hydroviews.scene.images import image_size
from hydroviews.scene.scenes import Scene, Split, View, every_eighth, make_scene, wrong_size


@dataclass(frozen=True)
class Pair:
    """A camera with its photographs, of one size; there is at least one."""

    rainy: View | None
    clean: View | None

    @property
    def view(self) -> View:
        """The camera, with the rainy photograph if there is one."""
        view = self.rainy or self.clean
        assert view is not None
        return view


def paired_scene(scene: Scene, pictures: Pictures, split: Split | None) -> Scene:
    """A scene that was captured in rain, with its clean photographs and a split between the two.

    Args:
        scene: as its cameras were read, each view with one of its photographs.
        pictures: those of the capture.
        split: the user's. If none: what is held out by its name; else every 8th, where all cameras have both
            photographs; else the cameras with a clean photograph, if these have no rainy one, or if there are at least
            as many others.

    Raises:
        InputError: no rainy or no clean photograph with a camera, names that match in part, photographs of one camera
            with different shapes, a view to train on whose photographs are the same, or an impossible split.
    """
    pairs = _pairs(scene, pictures, merged=pictures.together and split is None)
    _refuse_without_cameras(scene.name, pictures, pairs)
    chosen = split or _choose_split(scene.name, pictures, pairs)
    if split is None:
        pairs = [pair for pair in pairs if pair.view.name in {*chosen.train, *chosen.test}]
    notes = (*scene.notes, *_unused(scene, pictures, pairs))
    made = make_scene(scene.name, [pair.view for pair in pairs], scene.points, chosen, notes)
    ceiling = _check_split(made, {pair.view.name: pair for pair in pairs})
    clean = sorted((pair.clean for pair in pairs if pair.clean), key=lambda view: view.name)
    said = f"paired: {sum(pair.rainy is not None for pair in pairs)} rainy photographs, {len(clean)} clean; {ceiling}"
    return replace(made, notes=(*made.notes, said), captured_rainy=True, clean_views=tuple(clean))


def _pairs(scene: Scene, pictures: Pictures, merged: bool) -> list[Pair]:
    """The cameras with their photographs; merged, one for each key, with the clean photograph's where both have one."""
    key_of = {path: key for files in (pictures.rainy, pictures.clean, pictures.extra) for key, path in files.items()}
    clean = {*pictures.clean.values(), *pictures.extra.values()}
    views = sorted((view for view in scene.views if view.path in key_of), key=lambda view: view.path in clean)
    if merged:
        by_key = {key_of[view.path]: view for view in views}
        names = view_names([_below(view.path, pictures.folders) for view in by_key.values()])
        return [
            _pair(replace(view, name=name), pictures.rainy.get(key), pictures.clean.get(key))
            for (key, view), name in zip(by_key.items(), names, strict=True)
        ]
    own = {view.path for view in views}
    versions = {key: path for key, path in pictures.clean.items() if path not in own}
    return [
        _pair(view, None, view.path) if view.path in clean else _pair(view, view.path, versions.get(key_of[view.path]))
        for view in views
    ]


def _below(path: Path, folders: Sequence[Path]) -> str:
    return next(path.relative_to(folder).as_posix() for folder in folders if folder in path.parents)


def _pair(view: View, rainy: Path | None, clean: Path | None) -> Pair:
    """Both photographs of a camera, at the size of the smaller one."""
    shown = [_photographed(view, path) if path else None for path in (rainy, clean)]
    camera = min((one.camera for one in shown if one), key=lambda camera: camera.width)
    first, second = (replace(one, camera=camera) if one else None for one in shown)
    return Pair(first, second)


def _photographed(view: View, path: Path) -> View:
    """The view with another photograph, at that one's size.

    Raises:
        InputError: it has another shape.
    """
    if path == view.path:
        return view
    size, lens = image_size(path), view.lens
    expected = (view.camera.width, view.camera.height) if lens is None else (lens.width, lens.height)
    if not same_shape(size, expected):
        raise wrong_size(path, size, expected)
    return replace(view, path=path, camera=view.camera.resized(*(lens.pinhole(size)[:2] if lens else size)))


def _refuse_without_cameras(name: str, pictures: Pictures, pairs: Sequence[Pair]) -> None:
    clean = {**pictures.clean, **pictures.extra}
    kinds = (
        ("rainy", pictures.rainy, any(pair.rainy for pair in pairs)),
        ("clean", clean, any(pair.clean for pair in pairs)),
    )
    for kind, files, there in kinds:
        if not there:
            raise InputError(
                f"{name}: no {kind} photograph has a camera",
                found=f"cameras for {some(sorted(pair.view.path.name for pair in pairs))}; {kind} are "
                f"{some(sorted(path.name for path in files.values()))}",
                expected="the names that the cameras have, or cameras for all photographs in one file",
                fix="rename the photographs, or estimate all poses together: hydroviews poses FOLDER_OF_BOTH",
            )


def _choose_split(name: str, pictures: Pictures, pairs: Sequence[Pair]) -> Split:
    rainy = {pair.view.name for pair in pairs if pair.rainy}
    clean = {pair.view.name for pair in pairs if pair.clean}
    extra = {pair.view.name for pair in pairs if pair.view.path in pictures.extra.values()}
    if extra:
        return Split(tuple(sorted(rainy)), tuple(sorted(extra)))
    if rainy == clean:
        return every_eighth(sorted(rainy))
    both = rainy & clean
    if not pictures.together:
        clean -= both  # they are clean versions of what is trained on
    elif both and not (clean < rainy and len(clean) <= len(rainy) / 2):
        raise InputError(
            f"{name}: rainy and clean photographs match in part",
            found=f"{len(both)} names in both; rainy alone: {some(sorted(rainy - both))}; "
            f"clean alone: {some(sorted(clean - both))}",
            expected="the same names in both folders, no name in both, or clean ones of at most half of the rainy ones",
            fix=f"add, rename or remove photographs, or write {SPLIT}: views to train on need a rainy photograph, "
            "held-out ones a clean one",
        )
    return Split(tuple(sorted(rainy - clean)), tuple(sorted(clean)))


def _unused(scene: Scene, pictures: Pictures, pairs: Sequence[Pair]) -> list[str]:
    """Notes on the cameras that are neither trained on nor held out, and on photographs without a camera."""
    used = {view.path for pair in pairs for view in (pair.rainy, pair.clean) if view}
    seen = used | {view.path for view in scene.views}
    kinds = {"rainy": pictures.rainy, "clean": {**pictures.clean, **pictures.extra}}
    left = {
        f"{kind} photographs without a camera": [p.name for p in kinds[kind].values() if p not in seen]
        for kind in kinds
    }
    left["views neither to train on nor held out"] = [view.name for view in scene.views if view.path not in used]
    return [f"{len(names)} {what}: {some(sorted(names))}" for what, names in left.items() if names]


def _check_split(scene: Scene, pairs: dict[str, Pair]) -> str:
    """Whether all views to train on have a clean photograph too, in words.

    Raises:
        InputError: a view to train on has no rainy photograph, a held-out one no clean one; or there is no rain.
    """
    for what, kind, odd in (
        ("to train on", "rainy", [name for name in scene.split.train if not pairs[name].rainy]),
        ("held out", "clean", [name for name in scene.split.test if not pairs[name].clean]),
    ):
        if odd:
            raise InputError(
                f"{scene.name}: views {what} without a {kind} photograph", found=some(odd), fix=f"correct {SPLIT}"
            )
    train = [pairs[name] for name in scene.split.train]
    same = [
        pair.view.name
        for pair in train
        if pair.rainy and pair.clean and filecmp.cmp(pair.rainy.path, pair.clean.path, shallow=False)
    ]
    if same:
        raise InputError(
            f"{scene.name}: the rainy and the clean photograph are the same file",
            found=f"{len(same)} of {len(train)} views to train on: {some(same)}",
            expected="photographs with rain and without",
            fix="put the right photographs there, or remove the clean copies",
        )
    if all(pair.clean for pair in train):
        return "all views to train on are clean too"
    return "not all views to train on are clean too, so there is no ceiling (3dgs-clean)"
