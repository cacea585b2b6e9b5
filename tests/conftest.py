"""What tests share: one hook that orders and skips, devices, and the optional development data."""

import json
import os
import signal
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"  # beside the checkout, if at all

# Files of more than ten seconds begin first: none is left to one worker at the end.
LONG = (
    "test_readme.py",
    "viewer/test_window.py",
    "scenes/test_window_tool.py",
    "scenes/test_window_questions.py",
    "scenes/test_rig_window.py",
    "viewer/panels/test_gizmo.py",
    "scenes/test_window_sessions.py",
    "scenes/test_window_opening.py",
    "core/training/test_trainer.py",
    "commands/test_report.py",
    "test_api.py",
    "core/render/test_render.py",
    "core/training/run/test_distributed.py",
    "core/base/test_kernel_cache.py",
    "wings/lab/stability/test_measure.py",
    "core/training/run/test_exposure.py",
    "wings/capture/test_turntable.py",
    "wings/capture/test_cameras.py",
    "viewer/films/test_film.py",
    "commands/test_train.py",
    "commands/test_view.py",
    "scenes/test_poses.py",
    "scenes/test_shortages.py",
    "viewer/test_app.py",
    "core/base/test_children.py",
    "core/training/run/test_optimization.py",
    "test_packaging.py",
)
TESTS = Path(__file__).parent

SEED = int(os.environ.get("DEFORMRF_TEST_SEED", 0))  # make soak draws a new one


def pytest_report_header():
    return f"random inputs: DEFORMRF_TEST_SEED={SEED}"


@pytest.fixture(autouse=True)
def own_signals():
    """Give back the handlers of signals that a test's commands set.

    When a command is over, SIGINT ends its process: the next test's would be a worker's end.
    """
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {name: signal.getsignal(getattr(signal, name)) for name in names}
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells may have it ignored
    yield
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


@pytest.fixture(autouse=True)
def repeatable_random(request, monkeypatch):
    """np.random.default_rng() gives each test numbers that depend on SEED and the test's name.

    They do not depend on the test's file or on which tests run before it.
    """
    sequence = np.random.SeedSequence([SEED, zlib.crc32(request.node.name.encode())])
    default_rng = np.random.default_rng

    def seeded(seed=None):
        return default_rng(sequence.spawn(1)[0] if seed is None else seed)

    monkeypatch.setattr(np.random, "default_rng", seeded)


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory):
    """Sessions, preferences and logs of the tests' viewers don't go into the user's folders."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):
            patch.setenv(name, str(tmp_path_factory.mktemp(name.lower())))
        yield


def cuda_is_available():
    import warp as wp  # late: most tests of most files need no Warp

    return wp.is_cuda_available()


def pytest_collection_modifyitems(config, items):
    """Long files begin first.

    What is marked gpu is skipped where there is no CUDA device, and what is marked soak in a run
    that is neither make soak nor asks for it.
    """
    places = {TESTS / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path, len(LONG)))
    gpu_items = [item for item in items if item.get_closest_marker("gpu")]
    if gpu_items and not cuda_is_available():
        for item in gpu_items:
            item.add_marker(pytest.mark.skip(reason="needs a CUDA device"))
    if not SEED and "soak" not in config.option.markexpr:
        for item in items:
            if item.get_closest_marker("soak"):
                item.add_marker(pytest.mark.skip(reason="in make soak"))


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request):
    """Each device in turn, by Warp's name; the CUDA one skips itself."""
    return request.param


@pytest.fixture
def shared_data():
    """Path of a development data set by name; the test is skipped where it isn't."""

    def folder(name):
        if not (DATA / name).is_dir():
            pytest.skip(f"needs the development data set {name} in {DATA}")
        return DATA / name

    return folder


@pytest.fixture(scope="session")
def make_ball_field():
    """Make a small field with random contents: an opaque, dented ball with holes."""
    return _make_ball_field


def _make_ball_field(seed, spacing=0.08, occupied_share=0.7, gap=0.0, **options):
    """About 500 tets around (½, ½, ½); contents, occupancy and colors follow the seed.

    With a gap, there are two halves, on both sides of x = ½.
    """
    from deformrf.core.field import FieldOptions, pack_mask, random_field, subtet_corners
    from deformrf.core.geometry import a15_grid, extract, tet_neighbours

    rng = np.random.default_rng(seed)
    grid = a15_grid(spacing)
    middles = grid.rest_vertices[grid.tets].mean(axis=1) - 0.5
    inside = np.linalg.norm(middles * (1.0, 1.0, 0.8), axis=1) < 0.3
    mesh, _ = extract(grid, inside & (np.abs(middles[:, 0]) >= gap))
    options = FieldOptions(**{"table_size": 2**12, "march_step": 0.01, **options})
    field = random_field(mesh, tet_neighbours(mesh.tets), options, seed)
    weights, bias = field.density_layers[-1]
    bias = bias.copy()
    bias[0] += 2.5  # opaque enough to hide what is behind, thin enough to see inside
    # Caves with smooth walls: where an occupied sub-tet meets an empty one, float32 and
    # float64 may disagree about a piece, and trained fields have such places in sheets.
    centers = subtet_corners().mean(axis=1) @ mesh.rest_vertices[mesh.tets]
    waves = np.sin(rng.uniform(0, 6) + centers @ rng.normal(size=(3, 3)) * 12.0).sum(axis=-1)
    occupied = waves <= np.quantile(waves, np.clip(occupied_share, 0.0, 1.0))
    if occupied_share <= 0.0:
        occupied[:] = False
    return replace(
        field,
        density_layers=(*field.density_layers[:-1], (1.5 * weights, bias)),
        occupancy=pack_mask(occupied),
    )


@pytest.fixture(scope="session")
def write_dataset():
    """Write images as a data set in the Blender layout; see test_datasets.py."""
    return _write_dataset


def _write_dataset(folder, images, split="test", names=None, paths=None, **scene):
    """The folder, with one view per image: `names` are the files, `paths` what the JSON says.

    View i looks at the origin unless `poses` says otherwise; further keywords go to the JSON,
    and None removes a key.
    """
    (folder / split).mkdir(parents=True, exist_ok=True)
    names = names or [f"r_{i}.png" for i in range(len(images))]
    for image, name in zip(images, names, strict=True):
        image.save(folder / split / name, lossless=True, exact=True)  # WebP's options
    paths = paths or [f"./{split}/{name}" for name in names]
    poses = scene.pop("poses", [_pose(i) for i in range(len(paths))])
    frames = [
        {"file_path": path, "transform_matrix": np.asarray(pose).tolist()}
        for path, pose in zip(paths, poses, strict=True)
    ]
    scene = {"camera_angle_x": 0.7, "frames": frames, **scene}
    scene = {key: value for key, value in scene.items() if value is not None}
    (folder / f"transforms_{split}.json").write_text(json.dumps(scene))
    return folder


def _pose(view):
    from deformrf.core.render import look_at

    return look_at((4.0 * np.cos(view), 4.0 * np.sin(view), 1.0), (0.0, 0.0, 0.0))


@pytest.fixture
def data(tmp_path, write_dataset):
    """Three gray training views and two test views of 16x12 pixels."""
    from PIL import Image

    for split, count in (("train", 3), ("test", 2)):
        images = [Image.new("RGBA", (16, 12), (100, 100, 100, 255))] * count
        write_dataset(tmp_path / "data", images, split)
    return tmp_path / "data"


@pytest.fixture
def field():
    """A little field of random contents on a whole grid."""
    from deformrf.core.field import FieldOptions, random_field
    from deformrf.core.geometry import a15_grid, tet_neighbours

    mesh = a15_grid(0.25)
    options = FieldOptions(2, 2**10, (16,), (16,), march_step=0.05)
    return random_field(mesh, tet_neighbours(mesh.tets), options)


@pytest.fixture
def call(monkeypatch, capsys):
    """Call a command with arguments; the exit code and what went to stdout and stderr."""

    def call(command, *arguments):
        monkeypatch.setattr(sys, "argv", [command.__name__, *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            sys.exit(command())
        return SimpleNamespace(code=caught.value.code, **capsys.readouterr()._asdict())

    return call


@pytest.fixture
def refused():
    """Check that a command ended with one sentence on stderr and exit code 2; the sentence."""
    from deformrf.commands.running import INPUT_ERROR

    def refused(result):
        assert result.code == INPUT_ERROR
        assert result.err.count("\n") == 1 and result.err.endswith("\n"), result.err
        assert result.out == ""
        return result.err

    return refused


@pytest.fixture
def trainer(monkeypatch, field):
    """Stands in for the trainer: `calls` is what it was asked to do, `trained` its answer."""
    from deformrf.core import training
    from deformrf.core.training import Trained

    trained = Trained(field, {"seconds": 90.0}, interrupted=False)
    stub = SimpleNamespace(calls=[], trained=trained)

    def train(*arguments, workers, on_pause):
        assert workers.count == 1
        stub.calls.append(arguments)
        return stub.trained

    stub.train = train
    monkeypatch.setattr(training, "train", lambda *given, **named: stub.train(*given, **named))
    return stub


BALL_SIZE, BALL_ANGLE = 40, 0.7  # of its pictures [pixels, radians]


def ball_picture(pose):
    """A ball of radius 0.8, its color the normal, seen by a camera at `pose`.  RGBA uint8"""
    from PIL import Image

    from deformrf.core.render import camera_rays, from_field_of_view

    origins, directions = camera_rays(from_field_of_view(pose, BALL_ANGLE, BALL_SIZE, BALL_SIZE))
    b = np.einsum("ij,ij->i", origins, directions)
    discriminant = b**2 - ((origins**2).sum(axis=1) - 0.8**2)
    hit = discriminant > 0
    points = origins + (-b - np.sqrt(np.maximum(discriminant, 0)))[:, None] * directions
    rgba = np.zeros((BALL_SIZE * BALL_SIZE, 4))
    rgba[hit, :3], rgba[hit, 3] = (points / 0.8 * 0.5 + 0.5)[hit], 1.0
    return Image.fromarray((rgba.reshape(BALL_SIZE, BALL_SIZE, 4) * 255).round().astype(np.uint8))


@pytest.fixture(scope="session")
def ball_poses():
    from deformrf.core.render import look_at

    directions = np.random.default_rng(4).normal(size=(24, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [look_at(4.0 * d, (0, 0, 0)) for d in directions]


@pytest.fixture(scope="session")
def ball_folder(tmp_path_factory, write_dataset, ball_poses):
    """A data set of 24 views of the ball, 20 of them for training."""
    tmp_path = tmp_path_factory.mktemp("ball")
    for split, poses in (("train", ball_poses[:20]), ("test", ball_poses[20:])):
        images = [ball_picture(pose) for pose in poses]
        write_dataset(tmp_path, images, split, poses=poses, camera_angle_x=BALL_ANGLE)
    return tmp_path


@pytest.fixture(scope="session")
def ball_data(ball_folder):
    """Its views, for training and for testing."""
    from deformrf.core.training import load_dataset

    return load_dataset(ball_folder, "train"), load_dataset(ball_folder, "test")


@pytest.fixture(scope="session")
def ball():
    """A solid ball of random colors on 364 tets, quick to render: for the viewer's tests."""
    from deformrf.core.field import FieldOptions, random_field
    from deformrf.core.geometry import a15_grid, extract, tet_neighbours

    grid = a15_grid(1 / 14)
    centers = grid.rest_vertices[grid.tets].mean(axis=1) - 0.5
    mesh, _ = extract(grid, np.linalg.norm(centers * [1.3, 1.3, 1.0], axis=1) < 0.42)
    options = FieldOptions(3, 2**12, (16,), (16,), march_step=0.01)
    field = random_field(mesh, tet_neighbours(mesh.tets), options, contrast=2.0)
    weights, bias = (array.copy() for array in field.density_layers[-1])
    weights[:, 0], bias[0] = 0.0, 6.0
    return replace(field, density_layers=(*field.density_layers[:-1], (weights, bias)))


@pytest.fixture(scope="session")
def ball_file(ball, tmp_path_factory):
    """The ball as a model file."""
    from deformrf.core.field import modelfile

    path = tmp_path_factory.mktemp("model") / "ball.npz"
    modelfile.save(ball, path)
    return path


@pytest.fixture(scope="session")
def give_up_window():
    """End a test whose window can't be opened: skip it, or fail with DEFORMRF_REQUIRE_WINDOW=1."""

    def give_up(reason):
        if os.environ.get("DEFORMRF_REQUIRE_WINDOW") == "1":
            pytest.fail(f"{reason}, and DEFORMRF_REQUIRE_WINDOW is 1", pytrace=False)
        pytest.skip(reason)

    return give_up


@pytest.fixture
def window(give_up_window, monkeypatch, tmp_path_factory):
    """A window without a display, and its OpenGL context: (window, context).  Nothing is kept."""
    from deformrf.viewer.window import WindowError, open_window

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    try:
        window, context = open_window((320, 240), headless=True)
    except WindowError as error:
        give_up_window(str(error))
    yield window, context
    if window.context is not None:  # an App closes its own
        context.release()
        window.close()


EXPLAINED = 4e-4  # share of an image's pixels that rounding may explain: usually none or one
UNEXPLAINED = 1e-4  # share of the pixels that may differ for no such reason


@pytest.fixture(scope="session")
def assert_conforms():
    """Compare an image in conformance mode with the reference's."""
    return _assert_conforms


def _assert_conforms(color, expected, field, vertices, origins, directions, background):
    """At most 2/255 in 99.99 % of pixels, the others explained by rounding; 0.1/255 on average.

    A piece whose middle lies between an occupied and an empty sub-tet is there or not, as
    float32 rounds: then the reference itself changes as much within a few roundings, of the
    vertices, or of t, and so of where pieces lie from the entry on.
    """
    from deformrf.core.definition.image import render_rays

    assert np.isfinite(color).all()
    difference = 255.0 * np.abs(color - expected)
    assert difference.mean() <= 0.1
    off = np.flatnonzero(difference.max(axis=1) > 2.0)
    assert len(off) <= (EXPLAINED + UNEXPLAINED) * len(color)
    if len(off) == 0:
        return
    rng, spread = np.random.default_rng(), 0.0
    for _ in range(32):
        near = vertices + rng.normal(size=vertices.shape) * 5e-7
        step = field.options.march_step * (1.0 + 5e-5 * rng.normal())
        shifted = replace(field.definition, piece_length=step)
        moved, _, _ = render_rays(shifted, near, origins[off], directions[off], background)
        spread = np.maximum(spread, 255.0 * np.abs(moved - expected[off]).max(axis=1))
    unexplained = difference[off].max(axis=1) > spread + 2.0
    assert unexplained.sum() <= UNEXPLAINED * len(color), (off, difference[off].max(axis=1), spread)


@pytest.fixture
def hand():
    """A function that makes Controls with a hand that points at pixels of an image of 320 x 240."""
    from deformrf.viewer.tools import controls as c

    buttons, height = {"left": c.LEFT, "middle": c.MIDDLE, "right": c.RIGHT}, 240

    class Hand(c.Controls):
        @staticmethod
        def place(pixel):  # the window counts y upwards
            return pixel[0] - 0.5, height - 0.5 - pixel[1]

        def motion(self, pixel):
            self.on_mouse_motion(*self.place(pixel), 0, 0)

        def press(self, pixel, button, modifiers=0):
            self.at = pixel
            self.on_mouse_press(*self.place(pixel), buttons[button], modifiers)

        def drag(self, pixel, dx, dy):
            self.at = pixel
            self.on_mouse_drag(*self.place(pixel), dx, -dy, 0, 0)

        def release(self, button, modifiers=0):
            self.on_mouse_release(*self.place(self.at), buttons[button], modifiers)

        def click(self, pixel, modifiers=0):
            self.press(pixel, "left", modifiers)
            self.release("left", modifiers)

        def scroll(self, pixel, notches):
            self.on_mouse_scroll(*self.place(pixel), 0, notches)

        def pixel_of(self, handle):
            from deformrf.viewer.camera import picking

            return picking.project(self.camera, self.scene.handles.at([handle]))[0][0]

    def make(scene, depth_image=lambda: None, log=lambda *_, **__: None):
        made = Hand(scene, depth_image, log)
        made.size = 320, height
        return made

    return make
