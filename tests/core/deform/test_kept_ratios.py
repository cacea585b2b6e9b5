"""Ratios of thin parts are fitted once: at first need, in any thread, if no file has them."""

import os
import subprocess
import sys

import numpy as np
import pytest

from deformrf.core.deform import kept_ratios, sheets
from deformrf.core.deform.kept_ratios import SheetRatios

REST, TETS = np.eye(4, 3), np.arange(4)[None]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_ratios, "folder", lambda: tmp_path / "thin")
    monkeypatch.setattr(kept_ratios, "LEAST_SECONDS", -1.0)
    return tmp_path / "thin"


def fitted(values, rest=REST, tets=TETS):
    """Ratios, and how often they were fitted."""
    calls = []

    def fit():
        calls.append(1)
        return np.array([values, np.log(values)])

    return SheetRatios(fit, lambda values: values, rest, tets), calls


def test_they_follow_poissons_ratio_where_the_mesh_is_thin(folder):
    ratios, _ = fitted([1.0, 0.5, 2.0])
    assert ratios.at(sheets.RATIO).tolist() == [1.0, 0.5, 2.0]
    np.testing.assert_allclose(ratios.at(sheets.RATIO + 0.1), np.power([1.0, 0.5, 2.0], 1.1))


def test_they_are_fitted_once_whoever_asks(folder):
    ratios, calls = fitted([0.5])
    for _ in range(5):
        ratios.begin()
        assert ratios.at(sheets.RATIO).tolist() == [0.5]
    assert len(calls) == 1


def test_a_file_has_them_for_this_mesh_alone(folder):
    fitted([0.25, 4.0])[0].at(0.3)
    again, calls = fitted([9.0, 9.0])
    assert again.at(sheets.RATIO).tolist() == [0.25, 4.0] and not calls
    assert fitted([7.0, 7.0], rest=2.0 * REST)[0].at(sheets.RATIO).tolist() == [7.0, 7.0]
    assert fitted([8.0, 8.0], tets=TETS[:, ::-1])[0].at(sheets.RATIO).tolist() == [8.0, 8.0]


@pytest.mark.parametrize("cut", [0, 20, 40, -1])
def test_a_damaged_file_is_not_believed(folder, cut):
    fitted([0.25, 4.0])[0].at(0.3)
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:cut] + b"!")
    again, calls = fitted([0.5, 2.0])
    assert again.at(sheets.RATIO).tolist() == [0.5, 2.0] and calls
    third, calls = fitted([9.0, 9.0])
    assert third.at(sheets.RATIO).tolist() == [0.5, 2.0] and not calls


def test_without_a_folder_they_are_fitted_again(folder):
    folder.write_text("a file")
    for _ in range(2):
        ratios, calls = fitted([0.5])
        assert ratios.at(sheets.RATIO).tolist() == [0.5] and calls


def test_the_oldest_files_go(folder, monkeypatch):
    monkeypatch.setattr(kept_ratios, "MOST_FILES", 3)
    for k in range(5):
        fitted([k + 1.0], rest=REST + k)[0].at(0.3)
        for path in folder.iterdir():
            os.utime(path, ns=(path.stat().st_mtime_ns - 10**9,) * 2)
    assert len(list(folder.iterdir())) == 3
    assert fitted([9.0], rest=REST + 4)[0].at(sheets.RATIO).tolist() == [5.0]
    assert fitted([9.0], rest=REST)[0].at(sheets.RATIO).tolist() == [9.0]


def test_what_follows_another_mesh_has_its_ratios_and_is_not_fitted(folder):
    other, _ = fitted([0.5, 2.0, 3.0])
    ratios, calls = fitted([9.0, 9.0, 9.0])
    ratios.follow(np.array([[4, 2], [7, 8], [0, 1]]), other, np.array([[0, 1], [1, 2], [2, 4]]))
    assert ratios.at(sheets.RATIO).tolist() == [3.0, 1.0, 0.5] and not calls


def test_ratios_are_kept_in_the_order_of_tets_and_used_in_that_of_constraints(folder):
    def shuffled(first):
        return SheetRatios(lambda: np.array([[1.0, 2.0], [0.0, 0.0]]), first, REST, TETS)

    assert shuffled(lambda values: values).at(0.3).tolist() == [1.0, 2.0]
    assert shuffled(lambda values: values[:, ::-1]).at(0.3).tolist() == [2.0, 1.0]


def test_a_process_ends_although_thin_parts_are_being_fitted():
    """Without `_end`, nine of twelve such processes wait for threads of OpenBLAS for ever."""
    program = """
import time
import numpy as np
from deformrf.core.deform.kept_ratios import SheetRatios

def fit():
    matrix = np.ones((1500, 1500)) + np.eye(1500)
    while True:
        np.linalg.solve(matrix, matrix)

SheetRatios(fit, None, np.eye(4, 3), np.arange(4)[None]).begin()
time.sleep(0.3)
"""
    threads = {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    for _ in range(3):
        command, options = [sys.executable, "-c", program], {"timeout": 60, "capture_output": True}
        done = subprocess.run(command, env={**os.environ, **threads}, **options)
        assert (done.returncode, done.stderr) == (0, b"")


def test_few_tets_are_fitted_in_less_than_a_second(folder):
    assert fitted([0.5])[0].ready
    few, _ = fitted([0.5])
    many, calls = fitted([0.5], tets=np.zeros((2 * kept_ratios.MANY_TETS, 4), int))
    assert not many.ready and not calls
    few.follow(np.array([[0, 1]]), many, np.array([[0, 1]]))  # what is left after a cut
    assert not few.ready
    many.values()
    assert many.ready and few.ready and few.values().shape == (2, 1)
