"""A program that uses every name of the table in docs/api.md; tests/test_types.py gives it to mypy.

It is not run.  Annotations say what the docstrings of the API say.
"""

from pathlib import Path

import numpy as np

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
