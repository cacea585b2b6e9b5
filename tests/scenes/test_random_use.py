"""The benchmark of random use: a session of each body passes, and it notices what goes wrong."""

import numpy as np
import pytest
from random_use import ACTS, Session, bodies

MESHES = list(bodies())


@pytest.mark.parametrize("mesh", MESHES, ids=["ball", "neck", "two parts"])
def test_a_session_of_random_use_ends_at_rest(mesh, device):
    seed = int(np.random.default_rng().integers(2**32))
    assert Session(mesh, seed, device).run() is None, f"seed {seed}"


@pytest.mark.parametrize("act", ACTS, ids=lambda act: act.__name__)
def test_every_act_can_be_done_first(act):
    session = Session(MESHES[0], 1, "cpu")
    act(session)
    assert session.step() is None


def test_a_number_that_is_lost_is_noticed():
    session = Session(MESHES[0], 1, "cpu")
    lost = session.solver.vertices.numpy().copy()
    lost[session.used[0]] = np.nan
    session.solver.vertices.assign(lost)
    session.solver.set_options(session.solver.options)  # awake
    assert session.step() == "a number is not finite"


def test_a_body_that_stays_away_is_noticed(monkeypatch):
    session = Session(MESHES[0], 1, "cpu")
    session.solver.set_state(0.8 * session.solver.rest_vertices)
    monkeypatch.setattr(session.solver, "step", lambda dt: None)
    assert "away from its rest shape" in session.come_back()
