"""Points against pixels: a point has about the colour of the pixels where the cameras have it.

The correlation of both is compared, which haze, night and exposure leave as it is.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hydroviews.formats.checks.explanations import AS_READ, Explanation, explanations
from hydroviews.formats.checks.samples import Sample, in_front, places
from hydroviews.scene.exif import AS_STORED, orientation
from hydroviews.scene.scenes import View

# Correlations: none, a clear one, a clear improvement. Right captures have 0.6 and more, single views of them 0.4.
POOR, GOOD, BETTER = 0.3, 0.6, 0.3
UNCLEAR = 0.5  # below which explanations are tried
FEWEST = 25  # points seen that tell anything
CONTRAST = 0.03  # standard deviation of colours that tell anything


def are_coloured(sample: Sample) -> bool:
    """Whether the points are many enough, and not all of one colour."""
    return len(sample.positions) >= FEWEST and bool(sample.colours.std() >= CONTRAST)


def point_colours(sample: Sample) -> list[str]:
    """Sentences on colours of points that are not those of the pixels, of all views or of single ones."""
    if not are_coloured(sample):
        return []
    found = [_pairs(view, picture, sample, AS_READ) for view, picture in sample.pictures]
    each = [correlation(pairs) for pairs in found]
    known, overall, name = [value for value in each if value is not None], _overall(each), sample.scene.name
    why = explained(sample, overall) if overall < UNCLEAR else ""
    if why:
        return [f"{name}: the points' colours are not those of the pixels; as it seems, {why}{_exif(sample)}"]
    if overall < POOR and known:
        why = "are these the photographs, the cameras and the points of one scene, in the axes of the file's format?"
        return [f"{name}: the points' colours are not those of the pixels (correlation {overall:.2f}); {why}"]
    named = zip((view.name for view, _ in sample.pictures), each, strict=True)
    odd = [view for view, value in named if value is not None and value < POOR]
    if odd and overall >= GOOD:
        return [
            f"{name}: {', '.join(odd)}: the points' colours are not those of the pixels, as they are in other views; "
            "another photograph of that name, or a turned one?"
        ]
    return []


def explained(sample: Sample, before: float = 0.0) -> str:
    """The explanation with which points and pixels have a clear correlation, better than before; empty if none has."""
    tried = []
    for one in explanations():
        each = [correlation(_pairs(view, picture, sample, one)) for view, picture in sample.pictures]
        tried.append((_overall(each), one.says))
    best, says = max(tried, default=(0.0, ""))
    return says if best >= max(GOOD, before + BETTER) else ""


def _overall(each: Sequence[float | None]) -> float:
    """The median correlation; 0 of views in which too little is seen to tell."""
    return float(np.median([value or 0.0 for value in each]))


def _pairs(view: View, picture: NDArray, sample: Sample, change: Explanation) -> tuple[NDArray, NDArray]:
    """Colours of the points that a view shows, and of the pixels there: twice [n, 3]."""
    place, depth = places(view, change.cloud(sample.positions), change.pose(view.camera.world_to_camera))
    shown = in_front(place, depth)
    turned = change.picture(picture)
    rows, columns = (place[shown, ::-1] * turned.shape[:2]).astype(int).T
    return sample.colours[shown], turned[rows, columns]


def correlation(pairs: tuple[NDArray, NDArray]) -> float | None:
    """Pearson's, over the three channels, each without its mean; None where too little is seen to tell."""
    points, pixels = (colours - colours.mean(axis=0) if len(colours) else colours for colours in pairs)
    if len(points) < FEWEST or min(points.std(), pixels.std()) < CONTRAST:
        return None
    return float((points * pixels).mean() / (points.std() * pixels.std()))


def _exif(sample: Sample) -> str:
    """What Exif says of photographs that are to be turned."""
    tags = {orientation(view.path) for view, _ in sample.pictures} - {AS_STORED}
    if not tags:
        return ""
    said = ", ".join(map(str, sorted(tags)))
    return f"; Exif's Orientation is {said}: save the photographs upright if the cameras are those of upright ones"
