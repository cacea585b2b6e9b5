"""A program that uses every name of the table in docs/api.md; tests/test_types.py gives it to mypy.

It is not run.  Annotations say what the docstrings of the API say.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import deformrf
from deformrf import Model
from deformrf.core.deform import (
    LOWEST_POISSON_RATIO,
    PRESETS,
    TIME_STEP,
    Box,
    Material,
    Sphere,
    XpbdOptions,
    XpbdSolver,
    at_vertices,
    control_vertices,
    deformation_gradients,
    falloff,
    lowest_pins,
    rest_tets,
    strains,
    vertices_within,
    volume_ratios,
)
from deformrf.core.field import (
    FieldOptions,
    ModelFileError,
    TetField,
    cut,
    load,
    random_field,
    reduced,
    save,
    specks,
    without_specks,
)
from deformrf.core.geometry import (
    A15,
    BCC,
    EDGES,
    KUHN,
    EmbeddedSurface,
    Lattice,
    TetMesh,
    a15_grid,
    boundary_faces,
    cell_tets,
    components,
    edges,
    extract,
    face_components,
    fill_enclosed,
    lattice_spacing,
    lattice_vertices,
    located,
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.render import (
    MODES,
    Camera,
    Image,
    Lens,
    Mode,
    Renderer,
    RenderOptions,
    camera_rays,
    caption,
    distort,
    from_field_of_view,
    has_rays,
    in_space,
    look_at,
    pinhole,
    preview,
    render_mode,
    view_projection,
    visible_field,
)
from deformrf.core.training import (
    CheckpointError,
    Dataset,
    DatasetError,
    Lpips,
    NoImagesError,
    NoSplitError,
    Pause,
    Trained,
    TrainOptions,
    evaluate,
    list_cameras,
    load_checkpoint,
    load_dataset,
    preset,
    train,
)
from deformrf.viewer.document import Session, SessionError, load_session, poses
from deformrf.viewer.files import SurfaceMesh, save_surface, surface_of, with_colors
from deformrf.wings.capture import Capture, CaptureError, find_cameras, frames_of_video
from deformrf.wings.rig import (
    MESH_ENDINGS,
    METHODS,
    BonePose,
    Channel,
    Clip,
    GltfRig,
    Method,
    Rig,
    Skeleton,
    Skinner,
    VertexClip,
    aligned,
    arrays_of,
    automatic_weights,
    clip_of_poses,
    export_mesh,
    fitted_weights,
    load_rig,
    make_skeleton,
    mixed,
    reach,
    read_cache,
    read_gltf,
    rig_from,
    rigid_weights,
    skinned,
    turned,
)


def use_model(path: Path) -> list[deformrf.Image]:
    model: Model = deformrf.load(path, device="cpu")
    solver: XpbdSolver = model.solver(Material(), options=XpbdOptions(contact=True))
    model.set_vertices(solver.vertices)
    model.set_vertices(model.vertices.tolist())
    pose = deformrf.look_at((2, 2, 1), (0, 0, 0))
    camera: deformrf.Camera = deformrf.from_field_of_view(pose, 0.7, 64, 48)
    one: deformrf.Image = model.render(camera, RenderOptions(background=(0.0, 0.0, 0.0)))
    one.save(path.with_suffix(".png"))
    model.render().save("front.png")
    model.save(f"{model.device}.npz")
    print(deformrf.__version__, model.renderer.field is model.field)
    return model.render([camera, model.camera((1, 0, 0), width=64)])


def train_field(data: Path, model: str) -> TetField:
    options: TrainOptions = preset("tiny", spacing=0.06, coarse_steps=60)
    try:
        dataset: Dataset = load_dataset(data, "train", view_count=20, masks=data / "masks")
    except (NoImagesError, NoSplitError, DatasetError) as error:
        raise SystemExit(str(error)) from None

    def show(pause: Pause) -> None:
        share: float = pause.step / pause.step_count
        print(f"{share:.0%} after {pause.seconds:.0f} s", pause.export().mesh.tet_count)

    try:
        begun = load_checkpoint(f"{model}.checkpoint")
    except CheckpointError:
        begun = None
    trained: Trained = train(dataset, options, "cuda:0", resumed=begun, on_pause=show)
    if not trained.complete:
        print(trained.diverged or trained.out_of_memory, trained.report["seconds"])
    save(trained.field, model, {"note": "ours"}, entry_bits=8)
    test = load_dataset(str(data), "test")
    report = evaluate(trained.field, test, out_dir="out", lpips=Lpips("weights", "cuda:0"))
    mean: dict[str, float] = report["mean"]
    cameras, said = list_cameras(data)
    positions: list[np.ndarray] = [camera.position for camera in cameras]
    print(mean["psnr"], test.image(0).shape, test.first_pixels[-1], len(positions), *said)
    return trained.field


def reduce_field(path: str) -> TetField:
    try:
        field: TetField = load(path)
    except ModelFileError as error:
        raise SystemExit(str(error)) from None
    small: np.ndarray = specks(field, share=0.02)
    field = without_specks(reduced(field, keep=~small))
    return cut(field, [(0.0, 0.0, 0.0), (1.0, 1.0, 0.5)], keep_inside=True)


def make_field() -> TetField:
    mesh: TetMesh = a15_grid(0.05)
    neighbours: np.ndarray = tet_neighbours(mesh.tets)
    labels = face_components(neighbours, keep=signed_volumes(mesh.rest_vertices, mesh.tets) > 0)
    solid = fill_enclosed(labels == 0, neighbours)
    mesh, old_ids = extract(mesh, solid)
    faces, tets = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    parts = components(mesh.vertex_count, mesh.tets)
    print(len(edges(mesh.tets)), faces.shape, tets.shape, old_ids.shape, parts.max(), EDGES.shape)
    options = FieldOptions(level_count=4, density_hidden=(32,))
    return random_field(mesh, tet_neighbours(mesh.tets), options, seed=1, contrast=1.0)


def list_lattices(mesh: TetMesh) -> None:
    lattices: tuple[Lattice, ...] = (A15, BCC, KUHN)
    spacing: float | None = lattice_spacing(mesh)
    if spacing is not None:
        print(np.ptp(lattice_vertices(mesh.addresses, spacing), axis=0))
    print([(lattice.cell_edge, len(cell_tets(lattice))) for lattice in lattices])


def drag(field: TetField) -> np.ndarray:
    rest, tets = field.mesh.rest_vertices, field.mesh.tets
    materials: dict[str, Material] = PRESETS
    material = Material(young_modulus=5e5, poisson_ratio=max(0.3, LOWEST_POISSON_RATIO))
    around = Sphere((0.0, 0.0, 0.0), 0.1), Box((1.0, 0.0, 0.0), (0.2, 0.2, 0.2))
    options = XpbdOptions(gravity=(0.0, 0.0, -9.8), ground=0.0, colliders=around)
    solver = XpbdSolver(rest, tets, material, lowest_pins(rest, tets), options, device="cpu")
    solver.set_material(materials["jelly"])
    top = int(control_vertices(rest, tets, count=8)[0])
    ids: np.ndarray = vertices_within(rest, top, 0.1)
    shares: np.ndarray = falloff(rest, rest[top], ids, 0.1)
    solver.grab(ids, stiffness=100.0 * shares, force_limit=10.0)
    solver.move(rest[ids] + (0.1, 0.0, 0.0))
    solver.move_colliders([(0.0, 0.0, 0.2), (1.0, 0.0, 0.2)])
    while not solver.settled:
        solver.step(TIME_STEP)
    solver.release()
    vertices: np.ndarray = solver.vertices.numpy()
    shape = rest_tets(rest, tets)
    gradients: np.ndarray = deformation_gradients(vertices, shape)
    print(volume_ratios(gradients).min(), at_vertices(strains(gradients), shape, len(rest)).max())
    return vertices


def draw(field: TetField, vertices: np.ndarray) -> np.ndarray:
    visible, tet_ids = visible_field(field)
    renderer = Renderer(visible, device="cpu")
    renderer.set_vertices(vertices)
    camera: Camera = from_field_of_view(look_at((2, 2, 1), (0.5, 0.5, 0.5)), 0.7, 64, 48)
    options = RenderOptions(background=(0.0, 0.0, 0.0), conformance=True)
    image: Image = renderer.render(camera, options, rows=(0, 24))
    mode: Mode = "depth"
    print(caption(mode, (1.0, 3.0)), mode in MODES, len(tet_ids), image.sample_count)
    distances: np.ndarray = render_mode(
        renderer, camera, mode, depth_range=(1.0, 3.0)
    ).depth_array()
    origins, directions = camera_rays(camera, first_pixel=0, count=10)
    color, opacity, depth = renderer.render_rays(origins, directions, options)
    print(distances.shape, color.shape, opacity.shape, depth.shape)
    return image.color_array()


def place(camera: Camera, world_to_model: np.ndarray) -> Camera:
    lens: Lens = pinhole(500.0, 640, 480)
    x_d, y_d, *jacobian = distort(lens, np.zeros(3), np.ones(3))
    print(has_rays(lens), x_d.shape, y_d.shape, len(jacobian), view_projection(camera, 0.1, 10.0))
    return Camera(in_space(camera.camera_to_world, world_to_model), lens)


def outline(field: TetField) -> np.ndarray:
    surface: EmbeddedSurface = preview(field, Renderer(field))
    points: np.ndarray = surface.points(field.mesh.rest_vertices)
    tets, weights = located(field.mesh, field.neighbours, np.zeros(len(points), int), points)
    return np.column_stack([tets, weights])


def find(folder: str) -> Capture | None:
    photos: Path = frames_of_video(Path(folder) / "film.mp4", image_size=800)
    try:
        return find_cameras(photos, "work", is_sequence=True)
    except CaptureError:
        return None


def make_rig(mesh: TetMesh, field: TetField) -> dict[str, np.ndarray]:
    skeleton: Skeleton = make_skeleton(["root", "tip"], [-1, 0], np.zeros((2, 3)), np.ones((2, 3)))
    pose: BonePose = turned(skeleton, skeleton.rest_pose, skeleton.bone("tip"), (0.0, 0.5, 0.0))
    pose = mixed(pose, reach(skeleton, pose, 1, (1.0, 0.0, 1.0)), 0.5)
    clip: Clip = clip_of_poses("nod", np.arange(2.0), [skeleton.rest_pose, pose])
    channels: tuple[Channel, ...] = clip.channels
    cache: VertexClip = read_cache("cloth.pc2", mesh.vertex_count)
    rig = Rig(skeleton, automatic_weights(mesh, skeleton), (clip, cache))
    method: Method = "dual quaternion"
    posed: np.ndarray = skinned(
        mesh.rest_vertices, rig.weights, clip.matrices_at(skeleton, 0.5), method, rig.offsets
    )
    skinner = Skinner(mesh.rest_vertices, rigid_weights(mesh, skeleton), "cpu")
    count: int = len(skinner.pose(clip.matrices_at(skeleton, 1.0)))
    print(method in METHODS, len(channels), posed.shape, count)
    if field.rig_arrays is not None:
        rig = rig_from(field.rig_arrays, mesh.vertex_count)
    return arrays_of(rig)


def read_rigs(mesh: TetMesh) -> Rig:
    found: GltfRig = aligned(read_gltf("fox.glb"), np.eye(4))
    weights, offsets = fitted_weights(mesh, found.points, found.triangles, found.point_weights)
    print(weights.shape, None if offsets is None else offsets.shape)
    return load_rig("rig.npz", mesh.vertex_count)


def play(path: str, model: Model) -> Iterator[np.ndarray]:
    try:
        session: Session = load_session(path, model.field)
    except SessionError as error:
        raise SystemExit(str(error)) from None
    print(session.ticks, session.header["vertices"], session.events[0].name)
    yield from poses(path, model.field, every=2, device=model.device)


def export(model: Model) -> Path:
    mesh = model.field.mesh
    surface: SurfaceMesh = surface_of(mesh.tets, model.field.neighbours, model.vertices)
    save_surface(with_colors(surface, model.renderer, size=1.0), "posed.ply")
    return export_mesh(mesh, f"mesh{MESH_ENDINGS[1]}")
