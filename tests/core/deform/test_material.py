"""Materials: Lamé's constants from Young's modulus and Poisson's ratio."""

import warnings

import pytest

from deformrf.core.deform import PRESETS, Material


@pytest.mark.parametrize("ratio", [0.25, 0.3, 0.45, 0.499])
def test_moduli_are_those_of_an_isotropic_solid(ratio):
    material = Material(young_modulus=2e6, poisson_ratio=ratio)
    mu, lame = material.shear_modulus, material.shear_modulus + material.bulk_modulus
    assert mu * (3 * lame + 2 * mu) / (lame + mu) == pytest.approx(2e6)  # E
    assert lame / (2 * (lame + mu)) == pytest.approx(ratio)  # ν


def test_at_a_quarter_there_are_no_volume_constraints():
    assert Material(poisson_ratio=0.25).bulk_modulus == 0.0


def test_a_ratio_below_a_quarter_is_raised_with_a_warning():
    with pytest.warns(UserWarning, match=r"0\.1 is below 0\.25"):
        material = Material(young_modulus=1e6, poisson_ratio=0.1)
    assert material.held_poisson_ratio == 0.25
    assert material.bulk_modulus == 0.0
    assert material.shear_modulus == pytest.approx(1e6 / 2.5)


def test_presets_give_no_warning():
    assert set(PRESETS) == {"jelly", "rubber", "plush", "clay", "stiff"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for material in PRESETS.values():
            assert Material(**vars(material)) == material


@pytest.mark.parametrize(
    "wrong",
    [
        {"young_modulus": 0.0},
        {"young_modulus": float("nan")},
        {"density": -1.0},
        {"poisson_ratio": 0.5},
        {"damping": -0.1},
    ],
)
def test_impossible_values_are_named(wrong):
    with pytest.raises(ValueError, match=str(next(iter(wrong.values())))):
        Material(**wrong)
