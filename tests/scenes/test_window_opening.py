"""Files that are opened in a real X window, driven by xdotool as by a user's hand."""

import pytest
from PIL import Image
from xwindow import LiveViewer, missing_tools, screen

pytestmark = [pytest.mark.e2e, pytest.mark.gl]


@pytest.fixture
def session(ball_file, tmp_path, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    with screen(tmp_path) as display:
        made = LiveViewer(display, ball_file, tmp_path, "--size", "1000x700")
        yield made
        made.end()


def test_a_bad_file_is_told_of_and_a_good_one_opened(session, ball_file, tmp_path):
    (tmp_path / "bad.npz").write_text("no model")
    vertex, start = session.vertex()
    session.tool("key", "ctrl+o")
    session.next_state()
    session.tool("type", "--delay", "30", str(tmp_path / "bad.npz"))
    session.tool("key", "Return")
    session.wait(lambda: session.events("problem"), 20, "the bad file is told of")
    assert "bad.npz is not a model file" in session.last("problem")["sentence"]
    session.next_state()
    session.tool("key", "Escape")
    session.drag(start, (30, 0))
    session.wait(lambda: session.last("release"), 10, "the vertex is let go")
    assert session.last("grab")["vertex"] == vertex  # the scene is as it was
    session.tool("key", "ctrl+o")
    session.next_state()
    session.tool("type", "--delay", "30", str(ball_file))
    session.tool("key", "Return")
    session.wait(lambda: session.events("opened"), 30, "the model is opened")
    assert session.next_state()["max_displacement"] < 1e-6


def test_a_folder_of_photographs_is_answered_with_an_offer_to_train(tmp_path, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    photos = tmp_path / "photos"
    photos.mkdir()
    for number in range(3):
        Image.new("RGB", (16, 12), (80 * number, 90, 60)).save(photos / f"{number}.jpg")
    with screen(tmp_path) as display:
        viewer = LiveViewer(display, photos, tmp_path, "--size", "1000x700")
        assert "Train" in viewer.state()["dialog"]
        viewer.tool("key", "Escape")  # the bundled model is there to be looked at
        viewer.wait(lambda: viewer.state()["dialog"] is None, 20, "the offer is closed")
        assert len(viewer.state()["vertices"]) > 10
        viewer.tool("key", "ctrl+q")
        assert viewer.process.wait(20) == 0
