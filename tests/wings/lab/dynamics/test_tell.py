"""The section on dynamics says what was measured, and how many substeps the material needs."""

import io
from dataclasses import replace

import numpy as np
import pytest
from beams import ball
from PIL import Image

from deformrf.core.deform import PRESETS, Material
from deformrf.core.geometry import BCC, TetMesh
from deformrf.wings.lab.dynamics import tell as dynamics
from deformrf.wings.lab.dynamics.measure import (
    BOUND,
    SCENES,
    DynamicsRow,
    load_cases,
    measure,
    standing,
)
from deformrf.wings.lab.report.parts import record
from deformrf.wings.lab.stopwatch import Timing

MESH = ball(BCC, 1 / 4)
ONE_TET = TetMesh(
    rest_vertices=np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.7]]),
    addresses=np.zeros((4, 3), np.int32),
    tets=np.array([[0, 1, 2, 3]], np.int32),
)
COUNT = dynamics.DEFAULT_COUNT


@pytest.fixture(scope="module")
def shares():
    return []


@pytest.fixture(scope="module")
def section(shares):
    return dynamics.section(MESH, "cpu", quick=True, step=shares.append)


def row(scene, count, of_motion, compliance="material"):
    return DynamicsRow(
        scene=scene,
        scheme="substeps",
        compliance=compliance,
        count=count,
        of_motion=None if of_motion is None else 100.0 * of_motion,
        of_size=0.05,
        largest=0.1,
        reference_error=1e-9,
        frame=Timing(0.1 * count, 0.09 * count, 0.12 * count, 30),
        frames=12,
        default=False,
        chosen=False,
    )


def rows_with(static, dynamic, counts=(5, 10, 20, 40)):
    return [
        *map(row, ["static"] * 4, counts, static),
        *map(row, ["dynamic"] * 4, counts, dynamic),
    ]


@pytest.mark.parametrize(
    "static, dynamic, count",
    [
        ((0.05, 0.02, 0.005, 0.001), (0.03, 0.01, 0.005, 0.002), 20),
        ((0.009, 0.002, 0.001, 0.0001), (0.09, 0.05, 0.02, 0.01), 40),
        ((0.001, 0.001, 0.001, 0.001), (0.01, 0.01, 0.01, 0.01), 5),
        ((0.001, 0.001, 0.001, 0.001), (0.04, 0.03, 0.02, 0.011), None),
    ],
)
def test_the_least_count_that_holds_both_scenes_is_chosen(static, dynamic, count):
    rows = rows_with(static, dynamic)
    others = [
        row("dynamic", 2, 0.0, compliance="0.0001"),
        row("static", 3, None, compliance="0"),
    ]
    assert dynamics.chosen_count(rows) == count
    assert dynamics.chosen_count([*others, *rows]) == count


def test_findings_are_those_of_the_rows(section):
    static, dynamic = (r for r in section.tables[0].rows if r.default)
    assert (static.scene, dynamic.scene) == ("static", "dynamic")
    first, second = section.findings
    assert f"{COUNT} substeps" in first and f"{static.frame.median:.3g} ms" in first
    assert f"{static.of_motion:.2g} % of its motion" in first
    assert f"in motion by {dynamic.of_motion:.2g} %" in first
    chosen = [r for r in section.tables[0].rows if r.chosen]
    assert {r.count for r in chosen} == {section.values["recommended_substeps"]}
    assert max(r.of_motion for r in chosen) <= 100.0 * BOUND
    assert f"needs {chosen[0].count} substeps" in second
    assert f"{chosen[0].frame.median:.3g} ms" in second


def test_the_table_has_every_run(section):
    [table], [figure] = section.tables, section.figures
    assert (section.key, table.name, figure.name) == ("dynamics",) * 3
    assert set(table.headings) <= set(vars(table.rows[0])) and section.passed is None
    assert {r.scene for r in table.rows} == set(SCENES)
    for found in table.rows:
        assert (found.of_motion is None) == (found.compliance == "0")
        assert np.isfinite([found.of_size, found.largest]).all()
        assert found.of_size <= found.largest
    assert set(record(table.rows[0])) == set(record(table.rows[-1]))


def test_errors_are_in_percent(section):
    case = load_cases(standing(MESH))[1]
    found = measure(case, COUNT, "cpu")
    [row] = [r for r in section.tables[0].rows if r.default and r.scene == "dynamic"]
    names = ("of_motion", "of_size", "largest")
    measured = [getattr(found, name) for name in names]
    np.testing.assert_allclose([getattr(row, name) for name in names], measured)


def test_the_method_says_how_exact_the_references_are(section):
    cases = load_cases(standing(MESH))
    assert "48 tets" in section.method[0]
    assert f"{cases[0].gravity[0]:.2g} m/s²" in section.method[0]
    assert f"{cases[0].reference[1]:.0e} of the load" in section.method[0]
    assert f"{100 * cases[1].reference[1]:.1g} % of the motion" in section.method[0]


def test_the_figure_opens(section):
    image = Image.open(io.BytesIO(section.figures[0].png))
    assert image.format == "PNG" and image.width > image.height > 300
    assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 20


def test_the_share_that_is_done_grows(section, shares):
    assert len(shares) == len(section.tables[0].rows)
    assert shares == sorted(shares) and 0.0 < shares[0] and shares[-1] <= 1.0


def test_the_default_is_in_every_plan():
    cases = load_cases(standing(MESH))
    for quick in (True, False):
        own = {(c.scene, n) for c, n in dynamics.plan(cases, quick) if c.compliance is None}
        assert {(scene, COUNT) for scene in SCENES} <= own


def test_in_full_there_are_materials_too():
    section = dynamics.section(MESH, "cpu")
    table, materials = section.tables
    assert materials.name == "materials" and len(section.figures) == 1
    assert [r.material for r in materials.rows] == ["default", *PRESETS]
    assert materials.rows[0].substeps == section.values["recommended_substeps"]
    assert set(materials.headings) <= set(vars(materials.rows[0]))
    assert {r.compliance for r in table.rows} == {"material", "0", "1e-08", "1e-06", "0.0001"}


@pytest.fixture(scope="module")
def materials():
    """Of the ball, which the default material's rule gives few substeps."""
    body = standing(MESH)
    for chosen in range(1, 60):
        measured = [measure(c, chosen, "cpu") for c in load_cases(body)]
        if max(row.of_motion for row in measured) <= 100.0 * BOUND:
            break
    found = dynamics.held_materials(body, "cpu", measured, chosen)
    return {row.material: row for row in found}


def test_each_material_is_held_with_as_many_substeps_as_it_is_said_to_take(materials):
    """Also those of another Poisson's ratio; what takes more than 200 isn't measured."""
    assert list(materials) == ["default", *PRESETS]
    for found in materials.values():
        assert found.measured == (found.substeps <= dynamics.MOST_SUBSTEPS)
        assert found.measured == (found.of_motion is not None) == (found.frame is not None)
        if found.measured:
            assert max(found.of_motion, found.in_motion) <= 100.0 * BOUND, found
    assert materials["default"].measured and materials["jelly"].measured


def test_what_was_measured_is_another_measure_s(materials):
    body, found = standing(MESH), materials["rubber"]
    static, dynamic = load_cases(body, PRESETS["rubber"])
    errors = [measure(case, found.substeps, "cpu").of_motion for case in (static, dynamic)]
    np.testing.assert_allclose([found.of_motion, found.in_motion], errors, rtol=1e-3)


def test_stiff_and_light_materials_take_more_substeps(materials):
    counts = [materials[name].substeps for name in ("jelly", "rubber", "stiff")]
    assert counts[0] <= counts[1] < counts[2]
    standard = dynamics.softness(Material())
    for factor in (4.0, 100.0):
        stiff = Material(young_modulus=factor * Material().young_modulus)
        light = Material(density=Material().density / factor)
        for other in (stiff, light):
            assert dynamics.softness(other) == pytest.approx(factor * standard)


def test_without_resistance_there_is_no_equilibrium():
    loose = replace(
        MESH,
        rest_vertices=np.concatenate([MESH.rest_vertices, [[0.0, 0.0, 0.9]]]),
        addresses=np.concatenate([MESH.addresses, [[99, 99, 99]]]),
    )
    section = dynamics.section(loose, "cpu", quick=True)
    assert "moves without resistance" in section.findings[0]
    assert not section.tables and not section.figures and section.passed is None
