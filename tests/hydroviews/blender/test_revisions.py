"""What Blender made is kept from call to call, and known again by a number that is raised by hand: never forget to."""

import pytest

from hydroviews.blender.embedded_scenes import captures
from hydroviews.dataset.drawing_code import sources_digest
from hydroviews.rain.lens.optics import bake

COMMON = ("blender/cycles.py",)
RENDERED = (*COMMON, "blender/render_views.py", "blender/embedded_scenes")
WATER = (
    *(f"patterns/{name}" for name in ("water", "beads", "film", "fields", "runs", "shapes")),
    *(f"optics/{name}" for name in ("drop_surface", "mesh", "own_light", "path_matte", "bake")),
)
BAKED = (*COMMON, "blender/bake_drops.py", "blender/drop_scene.py", *(f"rain/lens/{name}.py" for name in WATER))


@pytest.mark.parametrize(
    ("what", "revision", "sources", "recorded"),
    [
        ("captures.VERSION", captures.VERSION, RENDERED, (2, "f1a72c571b735a52")),
        ("bake.VERSION", bake.VERSION, BAKED, (2, "c682748b7d1e8ba0")),
    ],
)
def test_code_that_makes_what_is_kept_changes_only_with_its_revision_in_view(what, revision, sources, recorded):
    found = (revision, sources_digest(sources))
    assert found == recorded, f"does this code make other pixels? Then raise {what}; and record {found} here"
