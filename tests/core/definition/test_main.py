"""python -m deformrf.core.definition: a picture of a drag, and errors in one sentence."""

import numpy as np
import pytest
from PIL import Image

from deformrf.core.definition import __main__ as program
from deformrf.core.field import save


@pytest.fixture
def few_substeps(monkeypatch):
    monkeypatch.setattr(program, "SUBSTEPS", 60)


@pytest.fixture(scope="module")
def model(make_ball_field, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "ball.npz"
    save(make_ball_field(1, spacing=0.12), path)
    return path


def test_a_drag_takes_a_vertex_and_leaves_the_lowest(make_ball_field, few_substeps):
    field = make_ball_field(1, spacing=0.12).definition
    rest = field.rest_vertices
    vertex, offset = program.drag_of("top:0.1,0,-.05", rest)
    x = program.dragged(field, vertex, offset)
    np.testing.assert_allclose(x[vertex], rest[vertex] + [0.1, 0.0, -0.05])
    low = program.lowest(rest)
    np.testing.assert_array_equal(x[low], rest[low])
    free = np.linalg.norm(x - rest, axis=1)[~low]
    assert 1e-3 < np.median(free) < 0.1


def test_pictures_are_written_and_a_drag_changes_them(model, tmp_path, few_substeps, capsys):
    rest, bent = tmp_path / "rest.png", tmp_path / "bent.png"
    program.main([str(model), "-o", str(rest), "--size", "12"])
    program.main([str(model), "-o", str(bent), "--size", "12", "--drag", "top:0.2,0,0"])
    assert "drawing 100 %" in capsys.readouterr().err
    before, after = (np.asarray(Image.open(path)).astype(int) for path in (rest, bent))
    assert before.shape == (12, 12, 3)
    assert before.min() < 200 and (before[0] == 255).all()  # the ball, before white
    assert np.abs(before - after).max() > 20


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "required"),
        (["missing.npz", "-o", "a.png"], "missing.npz"),
        (["MODEL", "-o", "a.jpg"], "write a .png"),
        (["MODEL", "-o", "nowhere/a.png"], "write a .png"),
        (["MODEL", "-o", "a.png", "--size", "0"], "1 pixel or more"),
        (["MODEL", "-o", "a.png", "--size", "many"], "--size"),
        (["MODEL", "-o", "a.png", "--drag", "top:1,2"], "write VERTEX:DX,DY,DZ"),
        (["MODEL", "-o", "a.png", "--drag", "top:nan,0,0"], "at most 100"),
        (["MODEL", "-o", "a.png", "--drag", "100000:0,0,0"], "a free vertex that exists"),
        (["MODEL", "-o", "a.png", "--drag=-1:0,0,0"], "a free vertex that exists"),
    ],
)
def test_errors_are_one_sentence(model, tmp_path, monkeypatch, capsys, words, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        program.main([str(model) if word == "MODEL" else word for word in words])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_model_is_refused_by_the_loader(tmp_path, capsys):
    path = tmp_path / "no.npz"
    np.savez(path, rest_vertices=np.zeros((1, 3)))
    with pytest.raises(SystemExit) as end:
        program.main([str(path), "-o", str(tmp_path / "a.png")])
    assert end.value.code == 2 and str(path) in capsys.readouterr().err
