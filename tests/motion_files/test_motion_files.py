"""Files for other programs, read back by libraries that did not write them."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pygltflib
import pytest
import trimesh
from plans import MOTIONS, POINT, planned, soft_rod, written
from scipy.spatial.transform import Rotation
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.solids import in_head_frame, pivot, signed_distance
from trunk_ocp.motion_files import glb, write_glb, write_sto, write_vtk
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.interpolation import interpolate
from trunk_ocp.problem.step_solids import head_solids
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene import colors as colors
from trunk_ocp.scene import keyframes, surfaces
from trunk_ocp.scene.body import Body, muscle_body, trunk_body
from trunk_ocp.scene.surroundings import logs, marks, tip_mass

pytestmark = pytest.mark.slow

FLOAT32 = 5e-7  # m; two roundings of lengths below 4 m

ARM = soft_rod("arm", ("[0.0, 0.4]", "[0.4, 1.0]"))

MUSCLES = """
muscles = [
  { group = "top", architecture = "longitudinal", radii_over_length = [0.0, 0.05], sector = [0.0, 1.5] },
  { group = "dl", architecture = "longitudinal", radii_over_length = [0.02, 0.05], sector = [1.6, 3.1], sides = ["L"] },
]
"""  # noqa: E501  # TOML's inline tables stand on one line

HANG = """
name = "hang"
anatomy = "arm.toml"

[bounds]
activation = [-2.0, 0.0]
extension = [0.5, 1.5]

[[phases]]
name = "turn"
duration = 0.123
interpolation = "none"
steps = 2
bounds = { head_z_deg = [10.0, 30.0], head_y_deg = [-20.0, 20.0] }

[[phases.targets]]
Z = 1.0
position = [0.1, 0.0, 0.9]
"""


@cache
def plan_of(name):
    return planned(name, "sequential")


@cache
def unloaded(trunk):
    """The initial shape, as a batch of one."""
    count = len(trunk.muscles)
    return solve_statics(trunk, np.zeros((1, count)), np.zeros((1, 2)), Loads(0.0))


def exact_volume(trunk, muscle):
    """Sector angle times (outer^2 - inner^2) / 2 times the integral of the taper squared."""
    k = trunk.taper_rate
    Z = np.array(trunk.edges)[[muscle.segment, muscle.segment + 1]]
    along = np.diff(Z - k * Z**2 + k**2 * Z**3 / 3)[0]
    inner, outer = muscle.radii
    return (muscle.sector[1] - muscle.sector[0]) * (outer**2 - inner**2) / 2 * along


def solid(vertices, triangles):
    """A closed mesh as trimesh sees it, nothing repaired; a fault fails the test."""
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.area_faces.min() > 0
    return mesh


# Geometry itself


def test_every_muscle_of_the_initial_shape_is_closed_and_has_its_subdomains_volume(trunk):
    for muscle in trunk.subdomains:
        body = muscle_body(trunk, muscle, unloaded(trunk))
        mesh = solid(body.vertices[0], body.triangles)
        assert mesh.volume == pytest.approx(exact_volume(trunk, muscle), rel=0.02)
        assert mesh.volume == pytest.approx(body.volume[0], rel=1e-9)


@pytest.mark.parametrize("sector", [(0.0, 0.05), (0.0, math.pi), (0.5, 6.0), (0.0, 2 * math.pi)])
@pytest.mark.parametrize("inner", [0.0, 1e-6, 0.1])
def test_degenerate_sectors_are_closed_and_have_their_volume(trunk, sector, inner):
    muscle = replace(trunk.subdomains[0], sector=sector, radii=(inner, 0.2))
    for body in (
        muscle_body(trunk, muscle, unloaded(trunk)),
        surfaces.coarse_body(trunk, muscle, unloaded(trunk), 9),
    ):
        mesh = solid(body.vertices[0], body.triangles)
        assert mesh.volume == pytest.approx(exact_volume(trunk, muscle), rel=0.02)


@pytest.mark.parametrize("name", MOTIONS)
def test_the_deformed_trunk_keeps_the_initial_volume_at_every_step(name):
    plan = plan_of(name)
    trunk = plan.motion.trunk
    initial = trunk_body(trunk, unloaded(trunk)).volume[0]
    body = trunk_body(trunk, plan.shape)
    np.testing.assert_allclose(body.volume, initial, rtol=0.01)
    for vertices in body.vertices[[0, -1]]:
        assert solid(vertices, body.triangles).volume == pytest.approx(initial, rel=0.01)


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_a_motion_has_as_many_keyframes_at_every_size(size):
    """Positions are those of a motion times `size`, as the trunk's length."""
    plan, Z = plan_of("pick-fruit"), np.linspace(0.0, 1.75, 9)
    ends = [(t, plan.sample(t).shape.position(Z)) for t in (0.0, 1.5)]

    class Scaled:
        motion = SimpleNamespace(trunk=SimpleNamespace(length=1.75 * size))

        def sample(self, t):
            real = plan.sample(t)
            place = SimpleNamespace(position=lambda Z: size * real.shape.position(Z))
            return SimpleNamespace(activation=real.activation, shape=place)

    a, b = ((t, size * position) for t, position in ends)
    wanted = [t for t, _, _ in keyframes._between(plan, Z, *ends, 5)]
    assert wanted
    assert [t for t, _, _ in keyframes._between(Scaled(), Z, a, b, 5)] == wanted


# glTF


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The .glb of each shipped motion, as trimesh and as pygltflib read it."""
    folder = tmp_path_factory.mktemp("glb")

    @cache
    def read(name):
        path = write_glb(plan_of(name), folder / f"{name}.glb")
        return SimpleNamespace(
            path=path,
            scene=trimesh.load_scene(path, process=False),
            gltf=pygltflib.GLTF2().load(path),
            plan=plan_of(name),
            frames=keyframes.for_blending(plan_of(name)),
        )

    return read


def array(gltf, index):
    """Values of an accessor, (count,) or (count, components)."""
    accessor = gltf.accessors[index]
    view = gltf.bufferViews[accessor.bufferView]
    kind = {5126: "<f4", 5125: "<u4"}[accessor.componentType]
    components = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
    values = np.frombuffer(
        gltf.binary_blob(),
        kind,
        accessor.count * components[accessor.type],
        view.byteOffset + accessor.byteOffset,
    )
    return values if accessor.type == "SCALAR" else values.reshape(accessor.count, -1)


def animation(gltf):
    """Key times (k,) in s and weights (k, targets)."""
    sampler = gltf.animations[0].samplers[0]
    assert sampler.interpolation == "LINEAR"
    times = array(gltf, sampler.input)
    return times, array(gltf, sampler.output).reshape(len(times), -1)


def muscle_nodes(gltf):
    return [node for node in gltf.nodes if "side" in node.extras]


def solid_nodes(gltf, *kinds):
    """Nodes of what surrounds the trunk, such as "head" or "target"."""
    return [node for node in gltf.nodes if node.extras.get("solid") in kinds]


def driven(gltf, node, path):
    """Times (k,) in s and values (k, ...) of a node's path, which may be still."""
    number = gltf.nodes.index(node)
    samplers = [
        gltf.animations[0].samplers[channel.sampler]
        for channel in gltf.animations[0].channels
        if (channel.target.node, channel.target.path) == (number, path)
    ]
    if not samplers:
        still = {"translation": (0.0, 0.0, 0.0), "scale": (1.0, 1.0, 1.0), "rotation": (0, 0, 0, 1)}
        return np.zeros(1), np.array([getattr(node, path) or still[path]])
    (sampler,) = samplers
    return array(gltf, sampler.input), array(gltf, sampler.output)


def before(times, values, time):
    """Value of a stepped path just before a time."""
    return values[np.searchsorted(times, np.float32(time)) - 1]


def shapes(gltf, node, attribute="POSITION"):
    """Values (n, v, 3) of a mesh's attribute at each key frame."""
    (primitive,) = gltf.meshes[node.mesh].primitives
    base = array(gltf, getattr(primitive.attributes, attribute))
    more = [array(gltf, target[attribute]) for target in primitive.targets]
    return base + np.array([np.zeros_like(base), *more])


def test_a_muscle_is_a_node_with_a_mesh_a_color_and_its_activations(files):
    file = files("pick-fruit")
    trunk = file.plan.motion.trunk
    nodes = muscle_nodes(file.gltf)
    assert [node.name for node in nodes] == list(trunk.muscles)
    assert len({node.mesh for node in nodes}) == 28
    for i, (node, muscle) in enumerate(zip(nodes, trunk.subdomains, strict=True)):
        extras = node.extras
        assert (extras["group"], extras["side"]) == (muscle.group, muscle.side)
        assert extras["segment"] == muscle.segment + 1
        np.testing.assert_allclose(extras["activation"], file.frames.activation[:, i], atol=1e-6)
    (root,) = (node for node in file.gltf.nodes if node.children)
    np.testing.assert_allclose(root.extras["times"], file.frames.times, atol=1e-6)
    np.testing.assert_allclose(root.extras["time_steps"], file.plan.motion.times, atol=1e-6)
    assert file.path.stat().st_size <= 6_000_000


def test_colors_are_those_of_okabe_and_ito_in_linear_light(files):
    gltf = files("pick-fruit").gltf
    for node in muscle_nodes(gltf):
        material = gltf.materials[gltf.meshes[node.mesh].primitives[0].material]
        linear = np.array(material.pbrMetallicRoughness.baseColorFactor)[:3]
        shown = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
        red, green, blue = np.round(255 * shown).astype(int)
        assert f"#{red:02X}{green:02X}{blue:02X}" == colors.GROUP_COLORS[node.extras["group"]]


def test_the_trunk_hangs_along_minus_Y_and_points_forwards_along_plus_Z(files):
    scene = files("pick-fruit").scene
    matrix, _ = scene.graph["R1-dl"]
    X, Y, Z = matrix[:3, :3].T
    np.testing.assert_allclose([X, Y, Z], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)


@pytest.mark.parametrize("name", MOTIONS)
def test_every_mesh_is_closed_outward_and_of_the_right_volume(files, name):
    file = files(name)
    trunk = file.plan.motion.trunk
    start = file.frames.shape
    for muscle in trunk.subdomains:
        mesh = file.scene.geometry[muscle.name].copy()
        mesh.merge_vertices(merge_norm=True, merge_tex=True)  # normals cut it open at its edges
        mesh = solid(mesh.vertices, mesh.faces)
        body = muscle_body(trunk, muscle, start)
        assert mesh.volume == pytest.approx(body.volume[0], rel=0.02)
    parts = {part.name for part in trunk.head.body}
    mesh = file.scene.geometry["skin"].copy()
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    mesh = solid(mesh.vertices, mesh.faces)
    covered = trunk_body(trunk, start).volume[0] * glb.SKIN_RADIUS**2
    assert mesh.volume == pytest.approx(covered, rel=0.03)
    around = {"skin", "target", "direction"} | {"log" if "log" in name else "tip mass"}
    assert set(file.scene.geometry) == {*trunk.muscles, *parts, *around}


@pytest.mark.parametrize("name", MOTIONS)
def test_the_head_turns_about_its_pivot_as_the_motion_does(files, name):
    gltf, plan, trunk = files(name).gltf, files(name).plan, files(name).plan.motion.trunk
    sampler = gltf.animations[0].samplers[1]
    times, turns = array(gltf, sampler.input), array(gltf, sampler.output)
    nodes = solid_nodes(gltf, "head")
    assert [node.name for node in nodes] == [part.name for part in trunk.head.body]
    turning = [
        channel.target.node
        for channel in gltf.animations[0].channels
        if (channel.sampler, channel.target.path) == (1, "rotation")
    ]
    assert turning == [gltf.nodes.index(node) for node in nodes]
    for node, part in zip(nodes, head_solids(trunk), strict=True):
        (primitive,) = gltf.meshes[node.mesh].primitives
        points = array(gltf, primitive.attributes.POSITION)
        np.testing.assert_allclose(node.translation, pivot(trunk), atol=FLOAT32)
        for i in (0, len(times) - 1):
            there = Rotation.from_quat(turns[i]).apply(points) + node.translation
            head = plan.trajectory[0 if i == 0 else -1, -2:]
            distance, _ = signed_distance(part, in_head_frame(trunk, there, head))
            np.testing.assert_allclose(distance, 0, rtol=0, atol=2e-6)


def test_the_log_is_where_the_motion_has_it_at_every_time(files):
    gltf, plan = files("lift-log").gltf, files("lift-log").plan
    (node,), (log,) = solid_nodes(gltf, "log"), logs(plan)
    times, centers = driven(gltf, node, "translation")
    assert set(np.append(0.0, plan.motion.times).astype("f4")) <= set(times)
    exact = [log.center(plan, min(time, plan.motion.times[-1])) for time in times.tolist()]
    np.testing.assert_allclose(centers, exact, rtol=0, atol=2e-6)
    (primitive,) = gltf.meshes[node.mesh].primitives
    points = array(gltf, primitive.attributes.POSITION)
    assert np.hypot(points[:, 0], points[:, 2]).max() == pytest.approx(log.radius, rel=1e-6)
    assert np.ptp(points[:, 1]) == pytest.approx(log.length, rel=1e-6)


def test_the_tip_carries_its_mass(files):
    gltf, plan = files("pick-fruit").gltf, files("pick-fruit").plan
    (node,), mass = solid_nodes(gltf, "tip mass"), tip_mass(plan)
    _, places = driven(gltf, node, "translation")
    np.testing.assert_allclose(places[0], mass.place, atol=FLOAT32)
    tip = np.array([plan.motion.trunk.length])
    ahead = plan.shape.directors(tip)[-1, 0, 2] * mass.radius
    np.testing.assert_allclose(places[-1], plan.shape.position(tip)[-1, 0] + ahead, atol=FLOAT32)
    assert node.scale is None  # it is never gone


@pytest.mark.parametrize("name", MOTIONS)
def test_targets_are_what_the_next_time_step_asks(files, name):
    gltf, plan = files(name).gltf, files(name).plan
    balls = {node.extras["Z"]: node for node in solid_nodes(gltf, "target")}
    arrows = solid_nodes(gltf, "direction")
    for number, step in enumerate(plan.motion.steps):
        asked = {mark.Z: mark for mark in marks(plan, number)}
        for Z, node in balls.items():
            size = before(*driven(gltf, node, "scale"), step.time)
            assert np.all(size == (Z in asked and asked[Z].placed))
            if Z in asked:
                place = before(*driven(gltf, node, "translation"), step.time)
                np.testing.assert_allclose(place, asked[Z].target, rtol=0, atol=FLOAT32)
        wanted = [(mark.Z, direction) for mark in asked.values() for direction in mark.directions]
        shown = []
        for node in arrows:
            if before(*driven(gltf, node, "scale"), step.time).any():
                turn = before(*driven(gltf, node, "rotation"), step.time)
                shown.append((node.extras["Z"], Rotation.from_quat(turn).apply((0.0, 0.0, 1.0))))
        assert [Z for Z, _ in shown] == [Z for Z, _ in wanted]
        for (_, drawn), (_, direction) in zip(shown, wanted, strict=True):
            unit = direction / np.linalg.norm(direction)
            np.testing.assert_allclose(drawn, unit, rtol=0, atol=1e-6)


def test_an_obstacle_of_one_phase_has_no_size_in_the_others(tmp_path):
    post = """
[[obstacles]]
name = "post"
shape = "sphere"
center = [2.0, 0.0, 0.0]
radius = 0.1
phases = ["rise"]
"""
    plan = plan_motion(load_motion(written(tmp_path, POINT + post)), lookahead=1)
    gltf = pygltflib.GLTF2().load(write_glb(plan, tmp_path / "post.glb"))
    (node,) = solid_nodes(gltf, "obstacles")
    times, sizes = driven(gltf, node, "scale")
    np.testing.assert_array_equal(times, [0.0, 1.0])
    np.testing.assert_array_equal(sizes, [[0, 0, 0], [1, 1, 1]])


@pytest.mark.parametrize("name", MOTIONS)
def test_key_frames_are_at_the_motions_times_and_weights_sum_to_one(files, name):
    file = files(name)
    times, weights = animation(file.gltf)
    steps = np.append(0.0, file.plan.motion.times).astype("f4")
    assert (times[0], times[-1]) == (steps[0], steps[-1])
    assert np.all(np.diff(times) > 0)
    assert set(steps) <= set(times)
    assert set(file.frames.times.astype("f4")) <= set(times)
    assert np.all(weights[0] == 0)  # the passive trunk: the meshes as they are
    np.testing.assert_array_equal(weights[1:].sum(axis=1), 1)
    assert set(np.unique(weights)) <= {0, 1}
    channels = [c for c in file.gltf.animations[0].channels if c.target.path == "weights"]
    assert sorted(c.target.node for c in channels) == list(range(29))  # muscles and skin
    assert {c.target.path for c in channels} == {"weights"}


@pytest.mark.parametrize("name", MOTIONS)
def test_positions_at_the_steps_are_those_of_the_geometry(files, name):
    file = files(name)
    trunk = file.plan.motion.trunk
    times, weights = animation(file.gltf)
    at = np.searchsorted(times, file.plan.motion.times.astype("f4"))
    sections = glb.sections_within(list(trunk.subdomains), len(file.frames.times), 3)
    for node, muscle in zip(muscle_nodes(file.gltf), trunk.subdomains, strict=True):
        seen = np.einsum("kt,tvx->kvx", weights[at], shapes(file.gltf, node)[1:])
        body = muscle_body(trunk, muscle, file.plan.shape, sections)
        # A vertex of the file is one of the geometry's; which, the first step tells.
        apart = np.linalg.norm(seen[0][:, None] - body.vertices[0], axis=-1)
        which = apart.argmin(axis=1)
        np.testing.assert_allclose(seen, body.vertices[:, which], rtol=0, atol=FLOAT32)


def test_normals_are_unit_outward_and_belong_to_the_faces_around_them(files):
    file = files("lift-log")
    for node in muscle_nodes(file.gltf):
        (primitive,) = file.gltf.meshes[node.mesh].primitives
        triangles = array(file.gltf, primitive.indices).reshape(-1, 3)
        position, normal = shapes(file.gltf, node), shapes(file.gltf, node, "NORMAL")
        np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
        for x, n in zip(position[[0, -1]], normal[[0, -1]], strict=True):
            mesh = trimesh.Trimesh(x, triangles, process=False)
            cosine = np.einsum("tvx,tx->tv", n[triangles], mesh.face_normals)
            assert cosine.min() > math.cos(math.radians(45))
        first = trimesh.Trimesh(position[0], triangles, process=False).face_normals
        cosine = np.einsum("tvx,tx->tv", normal[0][triangles], first)
        assert cosine.min() > math.cos(math.radians(20))  # edges are sharp


def test_between_key_frames_the_blend_is_near_the_motion(files):
    file = files("pick-fruit")
    frames, plan = file.frames, file.plan
    Z = np.linspace(0, plan.motion.trunk.length, 9)
    position = frames.shape.position(Z)
    jump = np.isin(frames.times[:-1], plan.jumps)
    for i in np.flatnonzero(~frames.held[1:] & ~jump):
        middle = plan.sample(frames.times[i : i + 2].mean()).shape.position(Z)
        blend = position[i : i + 2].mean(axis=0)
        assert np.linalg.norm(blend - middle, axis=-1).max() < 0.03
    # Halfway from rest to the fruit, blending the two steps would lose a quarter of the volume.
    body = trunk_body(plan.motion.trunk, frames.shape)
    blended = Body(((body.vertices[1:] + body.vertices[:-1]) / 2)[~jump], body.triangles)
    np.testing.assert_allclose(blended.volume, body.volume[0], rtol=0.04)


def test_without_an_equilibrium_in_between_the_key_frames_are_the_steps(monkeypatch):
    plan = plan_of("lift-log")
    rest = plan.sample(0.0)

    def sample(_, t):
        if t:
            raise StaticsError("no equilibrium", 0.5)
        return rest

    monkeypatch.setattr(type(plan), "sample", sample)
    np.testing.assert_array_equal(keyframes.for_blending(plan).times, [0.0, *plan.motion.times])


def test_a_phase_that_holds_jumps_within_a_millisecond(files):
    file = files("pick-fruit")
    times, weights = animation(file.gltf)
    held = [
        s.time
        for s, phase in zip(file.plan.motion.steps, phases(file.plan), strict=True)
        if phase.interpolation == "none"
    ]
    assert len(held) == 20
    for time in np.array(held, dtype="f4"):
        at = int(np.flatnonzero(times == time)[0])
        assert times[at] - times[at - 1] == pytest.approx(glb.JUMP_DURATION, rel=0.01)
        np.testing.assert_array_equal(weights[at - 1], weights[at - 2])


def phases(plan):
    return [plan.motion.phases[step.phase] for step in plan.motion.steps]


def test_unknown_groups_get_colors_of_their_own(trunk):
    groups = [f"group{i}" for i in range(9)]
    muscles = tuple(replace(trunk.subdomains[0], group=group) for group in [*groups, "dl"])
    found = colors.group_colors(replace(trunk, subdomains=muscles))
    assert found.get("dl", colors.GROUP_COLORS["dl"]) == colors.GROUP_COLORS["dl"]
    assert len({found[group] for group in groups}) == len(colors.EXTRA_COLORS)
    assert not set(colors.EXTRA_COLORS) & set(colors.GROUP_COLORS.values())


# VTK


def vtp(path):
    """A .vtp file: points, cells (c, k), arrays of cells and points, names and time."""
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    cells = data.GetPolys() if data.GetNumberOfPolys() else data.GetLines()
    corners = cells.GetMaxCellSize()
    fields = data.GetFieldData()
    names = fields.GetAbstractArray("muscle_names")

    def arrays(of):
        return {
            of.GetArrayName(i): vtk_to_numpy(of.GetArray(i)) for i in range(of.GetNumberOfArrays())
        }

    return SimpleNamespace(
        points=vtk_to_numpy(data.GetPoints().GetData()),
        cells=vtk_to_numpy(cells.GetConnectivityArray()).reshape(-1, corners),
        cell_data=arrays(data.GetCellData()),
        point_data=arrays(data.GetPointData()),
        names=[names.GetValue(i) for i in range(names.GetNumberOfValues())] if names else [],
        time=fields.GetArray("TimeValue").GetValue(0),
    )


def collection(path):
    """Times and files that a .pvd lists."""
    sets = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    return [float(s.get("timestep")) for s in sets], [path.parent / s.get("file") for s in sets]


@pytest.mark.parametrize("name", ["lift-log", "pick-fruit"])
def test_vtk_has_a_file_for_each_step_with_every_muscles_cells(tmp_path, name):
    plan = plan_of(name)
    trunk = plan.motion.trunk
    times, paths = collection(write_vtk(plan, tmp_path / "a" / "b")[0])
    after = [jump + keyframes.JUMP_DURATION for jump in plan.jumps]
    assert times == sorted([0.0, *plan.motion.times.tolist(), *after])
    side = {"R": 1, "L": -1}
    for step in (0, len(plan.x) - 1):
        data = vtp(paths[times.index(plan.motion.times[step])])
        assert data.time == plan.motion.times[step]
        assert data.names == list(trunk.muscles)
        for i, muscle in enumerate(trunk.subdomains):
            body = muscle_body(trunk, muscle, plan.part(step, step + 1))
            cells = data.cells[data.cell_data["muscle"] == i]
            assert len(cells) == len(body.triangles)
            np.testing.assert_allclose(
                data.points[cells], body.vertices[0][body.triangles], rtol=0, atol=FLOAT32
            )
            of_muscle = {
                k: set(v[data.cell_data["muscle"] == i]) for k, v in data.cell_data.items()
            }
            assert of_muscle["activation"] == {plan.activations[step, i]}
            assert of_muscle["segment"] == {muscle.segment + 1}
            assert of_muscle["side"] == {side[muscle.side]}


def test_vtk_starts_with_the_passive_trunk(tmp_path):
    plan = plan_of("lift-log")
    files = write_vtk(plan, tmp_path)
    assert [path.stem for path in files] == ["muscles", "centerline", "surroundings"]
    for path in files:
        _, paths = collection(path)
        assert len(paths) == 11
        assert vtp(paths[0]).time == 0
    first = vtp(tmp_path / "muscles_0000.vtp")
    assert set(first.cell_data["activation"]) == {0.0}


def test_vtk_has_head_log_and_obstacles_where_they_are(tmp_path):
    plan = plan_of("lift-log")
    trunk, head = plan.motion.trunk, plan.x[-1, -2:]
    data = vtp(collection(write_vtk(plan, tmp_path)[2])[1][-1])
    group = data.cell_data["group"]
    assert set(group) == {0, 1}
    (log,) = (solid for solid in plan.motion.steps[-1].solids if solid.group == "log")
    on_log = data.points[np.unique(data.cells[group == 1])]
    np.testing.assert_allclose(signed_distance(log, on_log)[0], 0, rtol=0, atol=2 * FLOAT32)
    on_head = in_head_frame(trunk, data.points[np.unique(data.cells[group == 0])], head)
    distances = [np.abs(signed_distance(part, on_head)[0]) for part in head_solids(trunk)]
    np.testing.assert_allclose(np.min(distances, axis=0), 0, rtol=0, atol=2 * FLOAT32)


def test_the_centerline_has_moment_and_extension(tmp_path):
    plan = plan_of("lift-log")
    _, paths = collection(write_vtk(plan, tmp_path)[1])
    mesh = plan.mesh
    for step in (0, 9):
        data, shape = vtp(paths[step + 1]), plan.part(step, step + 1)
        Z = data.point_data["Z"]
        assert set(plan.motion.trunk.edges) <= set(Z)
        np.testing.assert_allclose(data.points, shape.position(Z)[0], rtol=0, atol=FLOAT32)
        np.testing.assert_allclose(data.point_data["moment"], shape.moment(Z)[0], atol=1e-12)
        # |dr/dZ| is known at the Gauss points: a polynomial on each element.
        middle = (Z[:-1] + Z[1:]) / 2
        element, tau = mesh.locate(middle)
        nodes = (mesh.points[0] - mesh.edges[0]) / mesh.widths[0]
        for e in range(mesh.elements):
            slope = np.polynomial.Polynomial.fit
            expected = [
                slope(nodes, shape.slopes[0, e, :, axis], mesh.degree - 1)(tau[element == e])
                for axis in range(3)
            ]
            np.testing.assert_allclose(
                data.cell_data["extension"][element == e],
                np.linalg.norm(expected, axis=0),
                rtol=1e-5,
            )


# OpenSim


def sto(path):
    """Header, column names and table of a .sto file."""
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    header = dict(line.split("=") for line in lines[:end] if "=" in line)
    table = np.array([line.split("\t") for line in lines[end + 2 :]], dtype=float)
    return SimpleNamespace(
        name=lines[0],
        header=header,
        text=lines[:end],
        columns=lines[end + 1].split("\t"),
        table=table,
    )


@pytest.mark.parametrize("name", MOTIONS)
def test_sto_holds_minus_the_activations(tmp_path, name):
    plan = plan_of(name)
    file = sto(write_sto(plan, tmp_path / "a.sto"))
    assert file.name == name
    assert file.header == {
        "version": "1",
        "nRows": str(len(file.table)),
        "nColumns": "29",
        "inDegrees": "no",
    }
    assert file.columns == ["time", *plan.motion.trunk.muscles]
    assert any("minus the" in line for line in file.text)
    times, values = file.table[:, 0], file.table[:, 1:]
    assert np.all(np.diff(times) > 0)
    steps = [np.abs(times - t).argmin() for t in plan.motion.times]
    np.testing.assert_allclose(times[steps], plan.motion.times, atol=1e-9)
    np.testing.assert_allclose(values[steps], -plan.activations, atol=1e-9)
    assert np.all(values[0] == 0)
    assert times[0] == 0
    assert np.diff(times).max() <= 0.01 + 1e-9
    known = np.concatenate([np.zeros((1, 28)), plan.activations])
    for row in range(1, len(times), 7):
        if row not in steps:
            expected = -interpolate(plan.motion, known, times[row])
            np.testing.assert_allclose(values[row], expected, atol=1e-7)
    assert "-0.000000000" not in (tmp_path / "a.sto").read_text()


# All of them


def every_file(plan, folder):
    """Contents of all files, by name."""
    write_glb(plan, folder / "plan.glb")
    write_sto(plan, folder / "plan.sto")
    write_vtk(plan, folder / "vtk")
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_files_are_the_same_every_time_and_nothing_else_is_left(tmp_path):
    first, second = (every_file(plan_of("lift-log"), tmp_path) for _ in range(2))
    assert first == second
    assert len(first) == 2 + 3 * 11 + 3


def test_a_failed_write_leaves_what_was_there(tmp_path, monkeypatch):
    path = tmp_path / "plan.sto"
    path.write_text("before")

    def fail(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(InputError, match=r"plan.sto: cannot be written \(Permission denied\)"):
        write_sto(plan_of("lift-log"), path)
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["plan.sto"]


@pytest.mark.parametrize("export", [write_glb, write_vtk, write_sto])
def test_a_plan_without_steps_is_refused(tmp_path, export):
    plan = plan_of("lift-log")
    empty = replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.part(0, 0))
    with pytest.raises(InputError, match=r"no time steps.*plan it again"):
        export(empty, tmp_path / "none")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("muscles", ["", MUSCLES])
def test_other_trunks_and_motions_are_written(tmp_path, muscles):
    (tmp_path / "arm.toml").write_text(ARM + muscles)
    plan = plan_motion(load_motion(written(tmp_path, HANG)), throw=False)
    files = every_file(plan, tmp_path / "out")
    assert len(files) == 2 + 2 * 3 + 2
    scene = trimesh.load_scene(tmp_path / "out" / "plan.glb", process=False)
    names = ["R2-top", "L2-top", "L2-dl", "skin"] if muscles else ["arm"]
    names += ["target"]
    assert sorted(scene.geometry) == sorted(names)
    for mesh in scene.geometry.values():
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
        solid(mesh.vertices, mesh.faces)
    table = sto(tmp_path / "out" / "plan.sto")
    assert len(table.columns) == 1 + len(plan.motion.trunk.muscles)
    assert table.table[-1, 0] == pytest.approx(0.123)
    data = vtp(tmp_path / "out" / "vtk" / "muscles_0002.vtp")
    assert set(data.cell_data["muscle"]) == (set(range(3)) if muscles else {-1})


def test_a_plan_cut_short_ends_at_its_last_step(tmp_path):
    plan = plan_of("lift-log")
    short = replace(plan, x=plan.x[:3], tip_forces=plan.tip_forces[:3], shape=plan.part(0, 3))
    gltf = pygltflib.GLTF2().load(write_glb(short, tmp_path / "short.glb"))
    assert animation(gltf)[0][-1] == np.float32(plan.motion.times[2])
    assert sto(write_sto(short, tmp_path / "short.sto")).table[-1, 0] == plan.motion.times[2]
    assert len(collection(write_vtk(short, tmp_path)[0])[0]) == 4
