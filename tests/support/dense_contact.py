"""How deep a moving trunk is in bodies and in itself, by points on its surface, all in plain NumPy.

Nothing here calls trunk_ocp.contact or the distances of trunk_ocp.model.solids: shapes come from
`Plan.sample`, radii from the volume of the sampled tube, distances from the text-book formulas.
"""

import numpy as np
from scipy.spatial.transform import Rotation

ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)


def distance(solid, points):
    """Signed distance (...,) of points (..., 3) in the solid's frame."""
    x = np.abs((points - np.array(solid.center)) @ np.array(solid.axes).T)
    sizes = solid.sizes
    match solid.shape:
        case "sphere":
            return np.linalg.norm(x, axis=-1) - sizes[0]
        case "capsule":
            beyond = np.maximum(x[..., 2] - sizes[1], 0)
            return np.sqrt(x[..., 0] ** 2 + x[..., 1] ** 2 + beyond**2) - sizes[0]
        case "half-space":
            return (points - np.array(solid.center)) @ np.array(solid.axes)[2]
        case "cylinder":
            return _from_faces(np.stack([np.hypot(x[..., 0], x[..., 1]), x[..., 2]], -1) - sizes)
        case "box":
            return _from_faces(x - sizes)
        case "ellipsoid":
            return _from_ellipsoid(x, np.array(sizes))
    raise AssertionError(solid.shape)


def _from_faces(beyond):
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    return np.where(np.all(beyond < 0, axis=-1), beyond.max(axis=-1), outside)


def _from_ellipsoid(x, a):
    """By bisection for t in sum (a x / (a^2 + t))^2 = 1, which the nearest point solves."""
    low = np.full(x.shape[:-1], -(a.min() ** 2))
    high = np.max(a) * np.linalg.norm(x, axis=-1) + 1
    x = np.maximum(x, 1e-13)
    for _ in range(80):
        t = (low + high) / 2
        outside = np.sum((a * x / (a**2 + t[..., None])) ** 2, axis=-1) > 1
        low, high = np.where(outside, t, low), np.where(outside, high, t)
    nearest = a**2 * x / (a**2 + high[..., None])
    return np.sign(high) * np.linalg.norm(x - nearest, axis=-1)


def surface(trunk, shape, count):
    """Discs of one shape: Z (n,), centers (n, 3), unit normals (n, 3), radii (n,)."""
    Z = np.linspace(0, trunk.length, count + 1)
    center, normal = shape.position(Z), shape.directors(Z)[:, 2]
    pieces = np.linspace(0, trunk.length, 2001)
    length = np.linalg.norm(np.diff(shape.position(pieces), axis=0), axis=-1)
    initial = trunk.radius((pieces[1:] + pieces[:-1]) / 2) ** 2
    ratio = initial @ length / (initial @ np.diff(pieces))
    return Z, center, normal, trunk.radius(Z) / np.sqrt(ratio)


def disc_points(center, normal, radius):
    """Points (n, angles x 3, 3) on the rims of discs and inside them."""
    other = np.cross(normal, [0.48, 0.64, 0.6])
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    third = np.cross(normal, other)
    rim = np.cos(ANGLES)[:, None] * other[:, None] + np.sin(ANGLES)[:, None] * third[:, None]
    shares = np.array([1.0, 0.6, 0.0])[:, None, None]
    points = center[:, None, None] + radius[:, None, None, None] * shares * rim[:, None]
    return points.reshape(len(center), -1, 3)


def seen_from_head(trunk, points, head):
    """Where points are in the axes of the head, which turns about its pivot (eqs. 35-39)."""
    y, z = trunk.head.xi_y, trunk.head.xi_z
    to_base = np.array([np.cos(z) * np.sin(y), np.sin(z) * np.sin(y), np.cos(y)])
    pivot = -trunk.head.pivot_radius * to_base
    flat = Rotation.from_euler("ZY", head).inv().apply((points - pivot).reshape(-1, 3))
    return pivot + flat.reshape(points.shape)


def depth_in_itself(center, normal, radius):
    """How deep points of one disc are within another that is not beside it, m; negative outside."""
    step = np.linalg.norm(np.diff(center, axis=0), axis=-1)
    arc = np.append(0.0, np.cumsum(step))
    points = disc_points(center, normal, radius)
    deepest = -np.inf
    for i in range(len(center)):
        far = np.abs(arc - arc[i]) >= np.pi * (radius + radius[i]) / 2 + step.max()
        apart = points[i][:, None] - center[far]
        axial = np.sum(apart * normal[far], axis=-1)
        radial = np.linalg.norm(apart - axial[..., None] * normal[far], axis=-1)
        depth = np.where(np.abs(axial) <= step.max() / 2, radius[far] - radial, -np.inf)
        deepest = max(deepest, float(depth.max(initial=-np.inf)))
    return deepest


def deepest(plan, between=10, count=160):
    """(m, sentence) for where a plan is deepest in a body that it has to keep clear of.

    Depth counts from the clearance asked for; negative if all is clear.
    """
    motion, worst = plan.motion, (-np.inf, "")
    times = np.append(0.0, motion.times)
    for t, step in enumerate(motion.steps):
        still = motion.phases[step.phase].interpolation == "none"
        for time in [times[t + 1]] if still else np.linspace(times[t], times[t + 1], between + 1):
            sample = plan.sample(time, after=time == times[t])
            Z, center, normal, radius = surface(motion.trunk, sample.shape, count)
            points = disc_points(center, normal, radius)
            for solid in step.solids:
                if solid.group not in motion.contact:
                    continue
                part = (Z >= solid.Z[0]) & (Z <= solid.Z[1])
                seen = points[part]
                if solid.frame == "head":
                    seen = seen_from_head(motion.trunk, seen, sample.head)
                depth = solid.clearance - float(distance(solid, seen).min())
                worst = max(worst, (depth, f"{solid.name} at {time:.3f} s"))
            if "self" in motion.contact:
                worst = max(
                    worst, (depth_in_itself(center, normal, radius), f"self at {time:.3f} s")
                )
    return worst
