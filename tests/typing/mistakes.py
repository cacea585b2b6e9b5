"""Mistakes; each line's comment is mypy's name of the error that tests/test_types.py expects."""

import deformrf
import deformrf.core.field
from deformrf.core.deform import Material, XpbdSolver, lowest_pins
from deformrf.core.field import (
    load,
)
from deformrf.core.render import Renderer, RenderOptions, look_at
from deformrf.core.training import load_dataset, preset, train

deformrf.core.field.laod("model.npz")  # attr-defined
field = load(3)  # arg-type
field = load("model.npz")
field.mesh.vertices  # attr-defined
r = Renderer(field, "cpu")
r.rendr(3)  # attr-defined
r.render(3)  # arg-type
r.render()  # call-arg
r.render(look_at((2, 2, 1), (0, 0, 0)))  # arg-type
r.set_vertices(None)  # arg-type
RenderOptions(path="fastest")  # arg-type
RenderOptions(steps=3)  # call-arg
rest, tets = field.mesh.rest_vertices, field.mesh.tets
pins: str = lowest_pins(rest, tets)  # assignment
solver = XpbdSolver(rest, tets, Material(), pins, devise="cpu")  # call-arg
solver.step("1/60")  # arg-type
solver.setled  # attr-defined
solver.settled = True  # misc
train(load_dataset("data"), preset("tiny"))  # call-arg
train(load_dataset("data", "train"), "tiny")  # arg-type
preset("tiny").spacings  # attr-defined
m = deformrf.load("model.npz")
m.render(look_at((2, 2, 1), (0, 0, 0)))  # call-overload
m.render([m.camera()]).save("a.png")  # attr-defined
deformrf.laod("model.npz")  # attr-defined
