"""A scene has what its parts and the layers take of it, of the kinds that their protocols say."""

from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import pytest

from deformrf.viewer.document import Scene
from deformrf.viewer.document.history.undo import Undoable
from deformrf.viewer.document.rigging.posing import MovedByBones
from deformrf.viewer.document.rigging.rigging import Rigged
from deformrf.viewer.document.scene.clock import Timed
from deformrf.viewer.document.scene.cuts import Cuttable
from deformrf.viewer.document.scene.handles import Grabbable
from deformrf.viewer.document.scene.viewpoint import Viewed
from deformrf.viewer.document.sessions.session import Beginning, OpenObject
from deformrf.viewer.document.timeline.timeline import Keyed
from deformrf.viewer.layers.drawn import DrawnObject

OF_THE_DOCUMENT = (
    *(Undoable, MovedByBones, Rigged, Cuttable, Grabbable, Viewed, Timed, Keyed),
    *(Beginning, OpenObject),
)


@pytest.fixture(scope="module")
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.rigging.add_bone(-1, [0.5, 0.5, 0.3], [0.5, 0.5, 0.7])
    return made


def is_of(value, kind):
    if isinstance(kind, UnionType):
        return any(is_of(value, one) for one in get_args(kind))
    return kind is Any or isinstance(value, get_origin(kind) or kind)


def lacking(thing, protocol):
    """Yield the members that are not there, or are of another kind."""
    kinds = get_type_hints(protocol)
    names = {name for one in protocol.__mro__ for name in vars(one) if name[0] != "_"} | {*kinds}
    for name in names:
        kind, value = kinds.get(name), getattr(thing, name)
        if getattr(kind, "_is_protocol", False):
            yield from lacking(value, kind)
        elif not (callable(value) if kind is None else is_of(value, kind)):
            yield f"{protocol.__name__}.{name}: {type(value)}"


@pytest.mark.parametrize("protocol", [*OF_THE_DOCUMENT, DrawnObject], ids=lambda one: one.__name__)
def test_a_scene_has_what_is_taken_of_it(scene, protocol):
    assert list(lacking(scene, protocol)) == []


def test_another_kind_is_found(scene):
    class Wrong(Viewed):
        size: str

    assert list(lacking(scene, Wrong)) == ["Wrong.size: <class 'float'>"]
