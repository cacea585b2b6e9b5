"""Names and folders of files that the program writes."""

import errno
import os
import shutil
import socket
import stat

import pytest

from deformrf.core.base.paths import WriteError, free_name, whole_file, whole_files, working_folder


def test_a_name_is_free(tmp_path):
    assert free_name(tmp_path / "film.v2", ".jsonl") == tmp_path / "film.v2.jsonl"
    (tmp_path / "film.v2.jsonl").touch()
    (tmp_path / "film.v2-2.jsonl").symlink_to("nowhere")
    assert free_name(tmp_path / "film.v2", ".jsonl") == tmp_path / "film.v2-3.jsonl"


@pytest.mark.skipif(os.name != "posix", reason="a folder in use can't be deleted there")
def test_files_go_to_the_users_folder_if_the_current_one_is_gone(tmp_path, monkeypatch):
    from deformrf.viewer.films import FilmChoices, stamped

    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    assert working_folder() == tmp_path / "gone"
    shutil.rmtree(tmp_path / "gone")
    assert stamped("model", ".npz").parent == tmp_path
    assert FilmChoices("film").path == tmp_path / "film.mp4"


def test_a_file_appears_whole_and_touches_nothing_else(tmp_path):
    """A name of our own: somebody else's model.npz.part stays as it is."""
    path, theirs = tmp_path / "model.npz", tmp_path / "model.npz.part"
    theirs.write_text("theirs")
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as partial:
        assert partial.suffix == ".npz"
        partial.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    with whole_file(path) as partial:
        partial.write_text("new")
    assert (path.read_text(), theirs.read_text()) == ("new", "theirs")
    assert sorted(tmp_path.iterdir()) == [path, theirs]


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    order, fsync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda number: (order.append("fsync"), fsync(number)))
    monkeypatch.setattr(os, "replace", lambda *paths: (order.append("replace"), replace(*paths)))
    with whole_file(tmp_path / "a") as partial:
        partial.write_text("new")
    assert order[:2] == ["fsync", "replace"]


def test_of_several_files_all_are_written_or_none(tmp_path):
    old, new = tmp_path / "a", tmp_path / "b"
    old.write_text("old")
    new.mkdir()
    with pytest.raises(WriteError) as caught, whole_files([old, new]) as partials:
        for partial in partials:
            partial.write_text("new")
    assert caught.value.filename == str(new)
    assert old.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == [old, new]


def test_an_error_names_the_file_that_the_user_knows(tmp_path):
    with pytest.raises(WriteError, match="No space left") as caught, whole_file(tmp_path / "a"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert str(caught.value) == f"can't write {tmp_path / 'a'}: No space left on device"
    assert caught.value.errno == errno.ENOSPC
    with pytest.raises(WriteError, match=r"/none/a: No such file"), whole_file(tmp_path / "none/a"):
        pass


@pytest.mark.skipif(os.name != "posix", reason="permissions and links of POSIX")
class TestWhatIsThere:
    def test_a_file_keeps_its_permissions_also_while_it_is_written(self, tmp_path):
        path, new = tmp_path / "mine", tmp_path / "new"
        path.write_text("old")
        for mode in (0o600, 0o664, 0o640):
            path.chmod(mode)
            with whole_file(path) as partial:
                assert stat.S_IMODE(partial.stat().st_mode) == mode
                partial.unlink()  # as libraries do that rename a file of their own
                partial.write_text("new")
            assert stat.S_IMODE(path.stat().st_mode) == mode
        before = os.umask(0o027)
        try:
            with whole_file(new) as partial:
                partial.write_text("new")
        finally:
            os.umask(before)
        assert stat.S_IMODE(new.stat().st_mode) == 0o640

    @pytest.mark.parametrize("exists", [False, True])
    def test_a_link_is_written_through(self, tmp_path, exists):
        (tmp_path / "elsewhere").mkdir()
        target, link, first = tmp_path / "elsewhere" / "b", tmp_path / "a", tmp_path / "first"
        link.symlink_to("elsewhere/b")
        first.symlink_to(link)
        if exists:
            target.write_text("old")
        with whole_file(first) as partial:
            assert partial.parent == target.parent.resolve()
            partial.write_text("new")
        assert target.read_text() == "new" and not target.is_symlink()
        assert link.is_symlink() and first.is_symlink()
        assert list(target.parent.iterdir()) == [target]

    def test_what_is_no_file_is_named_and_stays(self, tmp_path, monkeypatch):
        (tmp_path / "loop").symlink_to("loop")
        (tmp_path / "null").symlink_to("/dev/null")
        (tmp_path / "folder").mkdir()
        os.mkfifo(tmp_path / "pipe")
        server = socket.socket(socket.AF_UNIX)
        monkeypatch.chdir(tmp_path)
        server.bind("socket")
        names = {"loop": "links", "null": "a device", "folder": "a folder", "pipe": "a pipe"}
        for name, word in {**names, "socket": "a socket"}.items():
            path = tmp_path / name
            before = path.lstat().st_ino
            with pytest.raises(WriteError, match=word), whole_file(path) as partial:
                partial.write_text("new")
            assert path.lstat().st_ino == before
        server.close()
        assert not [path for path in tmp_path.iterdir() if ".part" in path.name]
