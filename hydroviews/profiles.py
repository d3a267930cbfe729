"""Three sizes of the same benchmark: as data, so that a record can say which one it belongs to."""

from dataclasses import dataclass

from hydroviews.errors import unknown_name


@dataclass(frozen=True)
class Profile:
    """How large scenes are built and which patterns of each effect."""

    name: str
    long_side: int  # pixels; a capture is never enlarged
    patterns: tuple[int, ...]  # numbers of each effect's patterns: 0 is light, 1 medium, 2 heavy
    embedded_views: int  # of an embedded Blender scene, 4:3 at `long_side`


PROFILES = {
    profile.name: profile
    for profile in (
        Profile("demo", long_side=320, patterns=(1,), embedded_views=40),  # minutes on two cores
        Profile("quick", long_side=400, patterns=(0, 1, 2), embedded_views=100),  # what a laptop can sweep
        Profile("paper", long_side=1600, patterns=(0, 1, 2), embedded_views=200),  # for a GPU
    )
}


def find_profile(name: str) -> Profile:
    """The profile of that name.

    Raises:
        InputError: there is none.
    """
    if name not in PROFILES:
        raise unknown_name("PROFILE", name, "profile", PROFILES)
    return PROFILES[name]
