"""The section on dynamics says what was measured, and how many substeps the material needs."""

import io
from dataclasses import replace

import numpy as np
import pytest
from beams import ball
from PIL import Image

from deformrf.core.geometry import BCC
from deformrf.wings.lab.dynamics import section as dynamics
from deformrf.wings.lab.dynamics.measure import (
    BOUND,
    SCENES,
    DynamicsRow,
    load_cases,
    measure,
    standing,
)
from deformrf.wings.lab.stopwatch import Spread

MESH = ball(BCC, 1 / 4)
COUNT = dynamics.DEFAULT_COUNT


@pytest.fixture(scope="module")
def shares():
    return []


@pytest.fixture(scope="module")
def section(shares):
    return dynamics.section(MESH, "cpu", quick=True, step=shares.append)


def row(scene, count, of_motion):
    return DynamicsRow(
        scene=scene,
        count=count,
        of_motion=100.0 * of_motion,
        of_size=0.05,
        largest=0.1,
        frame=Spread(0.1 * count, 0.09 * count, 0.12 * count, 30),
        frames=12,
        default=False,
        chosen=False,
    )


@pytest.mark.parametrize(
    "static, dynamic, count",
    [
        ((5.0, 2.0, 0.5, 0.1), (3.0, 1.0, 0.5, 0.2), 20),
        ((0.9, 0.2, 0.1, 0.01), (9.0, 5.0, 2.0, 1.0), 40),
        ((0.1, 0.1, 0.1, 0.1), (1.0, 1.0, 1.0, 1.0), 5),
        ((0.1, 0.1, 0.1, 0.1), (4.0, 3.0, 2.0, 1.1), None),
    ],
)
def test_the_least_count_that_holds_both_scenes_is_chosen(static, dynamic, count):
    """Errors over the bound."""
    static, dynamic = (BOUND * np.array(errors) for errors in (static, dynamic))
    errors = zip((5, 10, 20, 40), static, dynamic, strict=True)
    rows = [row(s, n, e) for n, *both in errors for s, e in zip(SCENES, both, strict=True)]
    assert dynamics.chosen_count(rows) == count


def test_findings_are_those_of_the_rows(section):
    rows = section.tables[0].rows
    static, dynamic = (r for r in rows if r.default)
    assert (static.scene, dynamic.scene) == SCENES
    first, second = section.findings
    assert f"{COUNT} substeps" in first and f"{static.frame.median:.3g} ms" in first
    assert f"{static.of_motion:.2g} % of its motion" in first
    assert f"in motion by {dynamic.of_motion:.2g} %" in first
    chosen = [r for r in rows if r.chosen]
    assert {r.count for r in chosen} == {section.values["recommended_substeps"]}
    assert max(r.of_motion for r in chosen) <= 100.0 * BOUND
    assert f"needs {chosen[0].count} substeps" in second
    assert all(r.of_size <= r.largest for r in rows)


def test_errors_are_in_percent(section):
    case = load_cases(standing(MESH))[1]
    found = measure(case, COUNT, "cpu")
    [row] = [r for r in section.tables[0].rows if r.default and r.scene == "dynamic"]
    np.testing.assert_allclose(row.of_motion, found.of_motion)


def test_the_method_says_how_exact_the_references_are(section):
    static, dynamic = load_cases(standing(MESH))
    assert "48 tets" in section.method[0]
    assert f"{static.gravity[0]:.2g} m/s²" in section.method[0]
    assert f"{static.reference[1]:.0e} of the load" in section.method[0]
    assert f"{100 * dynamic.reference[1]:.1g} % of the motion" in section.method[0]


def test_the_figure_opens(section):
    image = Image.open(io.BytesIO(section.figures[0].png))
    assert image.format == "PNG" and image.width > image.height > 300
    assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 20


def test_the_share_that_is_done_grows(section, shares):
    assert len(shares) == len(section.tables[0].rows)
    assert shares == sorted(shares) and 0.0 < shares[0] and shares[-1] == 1.0


def test_without_resistance_there_is_no_equilibrium():
    loose = replace(
        MESH,
        rest_vertices=np.concatenate([MESH.rest_vertices, [[0.0, 0.0, 0.9]]]),
        addresses=np.concatenate([MESH.addresses, [[99, 99, 99]]]),
    )
    section = dynamics.section(loose, "cpu", quick=True)
    assert "moves without resistance" in section.findings[0]
    assert not section.tables and not section.figures and section.passed is None
