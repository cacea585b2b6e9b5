"""The minimum cut, against all labellings of small graphs, and what it promises."""

from itertools import pairwise, product

import numpy as np
import pytest

from deformrf.core.field.isolation import cutting
from deformrf.core.field.isolation.cutting import WHOLE, minimum_cut, near_minimum_cut


def cost(kept, pulls, pairs, ties):
    """Of a labelling [N] bool, in float64."""
    parted = kept[pairs[:, 0]] != kept[pairs[:, 1]]
    own = np.where(kept, np.maximum(-pulls, 0.0), np.maximum(pulls, 0.0))
    return own.sum() + ties[parted].sum()


@pytest.mark.parametrize("trial", range(8))
def test_no_labelling_costs_less(trial):
    rng = np.random.default_rng()
    count = 9
    pairs = np.array([(i, j) for i in range(count) for j in range(i) if rng.random() < 0.4])
    pulls, ties = rng.normal(size=count), rng.uniform(0.0, 1.0, len(pairs))
    held = np.zeros(count, int)
    held[:2] = 1, -1
    kept = minimum_cut(pulls, pairs, ties, held)
    labellings = np.array([(1, 0, *rest) for rest in product((0, 1), repeat=count - 2)], bool)
    least = min(cost(one, pulls, pairs, ties) for one in labellings)
    rounded = (len(pairs) + count) / WHOLE  # each capacity is a whole number
    assert cost(kept, pulls, pairs, ties) <= least + rounded


def test_what_is_held_stays_on_its_side_against_all_evidence():
    rng = np.random.default_rng()
    pairs = np.array([(i, i + 1) for i in range(49)])
    held = rng.integers(-1, 2, 50)
    kept = minimum_cut(-100.0 * held, pairs, np.ones(49), held)
    assert kept[held > 0].all() and not kept[held < 0].any()


def test_the_weakest_tie_of_a_chain_is_parted():
    pairs = np.array([(i, i + 1) for i in range(9)])
    ties = np.full(9, 2.0)
    ties[5] = 0.5
    held = np.array([1, *[0] * 8, -1])
    kept = minimum_cut(np.zeros(10), pairs, ties, held)
    np.testing.assert_array_equal(kept, np.arange(10) <= 5)


def test_both_sides_are_treated_alike():
    """With signs turned, what was kept is not, where no two cuts cost the same."""
    rng = np.random.default_rng()
    pairs = np.array([(i, j) for i in range(12) for j in range(i) if rng.random() < 0.4])
    pulls, ties = rng.normal(size=12), rng.uniform(0.0, 1.0, len(pairs))
    held = np.zeros(12, int)
    one, other = (minimum_cut(sign * pulls, pairs, ties, held) for sign in (1, -1))
    np.testing.assert_array_equal(one, ~other)


def test_without_pulls_and_ties_only_what_is_held_is_kept():
    held = np.array([1, 0, -1, 0])
    pairs = np.zeros((0, 2), int)
    np.testing.assert_array_equal(minimum_cut(np.zeros(4), pairs, np.zeros(0), held), held > 0)


def chains(rng, length=40, group=5):
    """Chains that lie side by side, each tied to the next: pairs, pulls, ties, held and groups."""
    numbers = np.arange(length * length).reshape(length, length)
    along = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)
    pairs = np.concatenate([along, np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=1)])
    held = np.zeros((length, length), int)
    held[:, 0], held[:, -1] = 1, -1
    row, column = np.indices((length, length)) // group
    ties = rng.uniform(0.5, 1.0, len(pairs))
    return pairs, np.zeros(length**2), ties, held.ravel(), (row * length + column).ravel()


@pytest.mark.parametrize("larger", [(), (20,), (20, 10)])
def test_a_cut_by_groups_costs_little_more_than_the_least(larger):
    pairs, pulls, ties, held, groups = chains(np.random.default_rng())
    row, column = np.indices((40, 40))
    within = [((row // size) * 40 + column // size).ravel() for size in larger]
    least = cost(minimum_cut(pulls, pairs, ties, held), pulls, pairs, ties)
    kept = near_minimum_cut(pulls, pairs, ties, held, [*within, groups])
    assert kept[held > 0].all() and not kept[held < 0].any()
    assert cost(kept, pulls, pairs, ties) < 1.1 * least
    each = near_minimum_cut(pulls, pairs, ties, held, [np.arange(len(held))])
    assert cost(each, pulls, pairs, ties) <= least + len(pairs) / WHOLE


def test_each_round_at_the_border_makes_a_cut_cheaper(monkeypatch):
    rng, sums = np.random.default_rng(), np.zeros(3)
    for _ in range(20):
        pairs, pulls, ties, held, groups = chains(rng)
        for rounds in range(3):
            monkeypatch.setattr(cutting, "ROUNDS", rounds)
            kept = near_minimum_cut(pulls, pairs, ties, held, [groups])
            sums[rounds] += cost(kept, pulls, pairs, ties)
    assert sums[0] > 1.01 * sums[1] and sums[1] >= sums[2] - 1e-9


def test_each_round_frees_whole_groups_at_the_border(monkeypatch):
    """So that the border can move by a group in each, not by a node."""
    pairs, pulls, ties, held, groups = chains(np.random.default_rng())
    by_groups, steps = cutting.cut_by_groups, []

    def noted(pulls, pairs, ties, sides, group):
        steps.append((sides, by_groups(pulls, pairs, ties, sides, group)))
        return steps[-1][1]

    monkeypatch.setattr(cutting, "cut_by_groups", noted)
    near_minimum_cut(pulls, pairs, ties, held, [groups])
    assert len(steps) == 1 + cutting.ROUNDS
    for (_, (before, parted)), (sides, _) in pairwise(steps):
        a, b = pairs[parted].T
        differ = before[pairs[:, 0]] != before[pairs[:, 1]]
        np.testing.assert_array_equal(parted, np.flatnonzero(differ))
        at_border = np.isin(groups, np.concatenate([groups[a], groups[b]]))
        np.testing.assert_array_equal(sides == 0, at_border & (held == 0))


def test_a_cut_by_groups_moves_to_a_neck_within_a_group():
    pairs, pulls, ties, held, groups = chains(np.random.default_rng())
    ties[((pairs % 40 > 13) & (pairs % 40 < 21)).all(axis=1)] *= 0.5  # a group has 15 to 19
    ties[(pairs % 40 == 17).any(axis=1) & (pairs % 40 == 18).any(axis=1)] = 0.01
    kept = near_minimum_cut(pulls, pairs, ties, held, [groups])
    np.testing.assert_array_equal(kept, np.arange(len(held)) % 40 <= 17)
