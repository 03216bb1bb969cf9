"""Colors of muscles, head, obstacles and tip mass, the same in figures, film, page and files."""

from __future__ import annotations

from ..model.anatomy import Trunk

# Okabe & Ito's palette, which people with any color vision can distinguish. The elephant's groups
# by name; those of other trunks in the order they appear.
GROUP_COLORS = {
    "dl": "#0072B2",
    "ovo": "#D55E00",
    "ivo": "#E69F00",
    "dr": "#009E73",
    "vr": "#CC79A7",
}
MASS = "#7A3B69"  # the mass that hangs on the tip
WOOD = "#B08D57"  # logs
TARGET = "#CC0055"
HEAD = "#B8ADA2"
OBSTACLE = "#7F9CC0"
EXTRA_COLORS = ("#56B4E9", "#882255", "#999933", "#332288", "#6B6B6B", "#44AA99", "#AA4499")


def groups(trunk: Trunk) -> tuple[str, ...]:
    """Names of a trunk's muscle groups, in the order of the anatomy file."""
    return tuple(dict.fromkeys(muscle.group for muscle in trunk.subdomains))


def group_colors(trunk: Trunk) -> dict[str, str]:
    """Color "#RRGGBB" of each muscle group of a trunk."""
    known = {group: GROUP_COLORS[group] for group in groups(trunk) if group in GROUP_COLORS}
    rest = [group for group in groups(trunk) if group not in GROUP_COLORS]
    return known | {group: EXTRA_COLORS[i % len(EXTRA_COLORS)] for i, group in enumerate(rest)}
