"""What a person does with the add-on, done by Blender without a window; run by bpy's Python.

    python blender_rig.py ADDON MESH.ply FOLDER

Installs the add-on as the dialog does, imports the mesh, makes a skeleton of three bones, binds,
animates it, and exports; FOLDER then has rig.npz, volume.npz (Preserve Volume), scaled.npz and
scaled_volume.npz (a bone that is scaled, too), shape.npz, actions.npz, rig.pc2, and facts.json.
"""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

ADDON, MESH, FOLDER = sys.argv[-3], sys.argv[-2], Path(sys.argv[-1])


def positions(obj):
    posed = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = posed.to_mesh()
    values = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", values)
    posed.to_mesh_clear()
    return values.reshape(-1, 3)


def refused(operator, **arguments):
    """The sentence with which an operator ends."""
    try:
        operator(**arguments)
    except RuntimeError as error:
        return str(error)
    return ""


class Layout:
    """Stands in for a panel's layout: there is no window.  Keeps what is written on it."""

    def __init__(self):
        self.written = []

    def box(self):
        return self

    def column(self, **_):
        return self

    row = column

    def label(self, text, **_):
        self.written.append(text)

    def operator(self, name, **_):
        self.written.append(name)
        return SimpleNamespace()

    def prop(self, *_, **__):
        pass


def panel():
    """What the add-on's panel shows now."""
    layout = Layout()
    kind = bpy.types.DEFORMRF_PT_panel
    kind.draw(SimpleNamespace(layout=layout), bpy.context)
    return layout.written


def skeleton(obj):
    """Three bones from the lowest point of the mesh to its top, along the height."""
    bpy.ops.deformrf.add_skeleton()
    armature = bpy.context.scene.deformrf.armature
    bones = armature.data.edit_bones
    co = np.array([v.co for v in obj.data.vertices])
    low, high = co.min(axis=0), co.max(axis=0)
    middle = 0.5 * (low + high)
    last = bones["Root"]
    heights = np.linspace(low[2], high[2], 4)
    last.head, last.tail = (*middle[:2], heights[0]), (*middle[:2], heights[1])
    for name, height in zip(("Middle", "Top"), heights[2:], strict=True):
        bone = bones.new(name)
        bone.head, bone.tail = last.tail, (*middle[:2], height)
        bone.parent, bone.use_connect = last, True
        last = bone
    bpy.ops.object.mode_set(mode="OBJECT")
    return armature


def animate(armature):
    bpy.context.scene.frame_end = 12
    for frame, angle in ((1, 0.0), (12, 0.9)):
        for i, name in enumerate(("Root", "Middle", "Top")):
            bone = armature.pose.bones[name]
            bone.rotation_mode = "XYZ"
            bone.rotation_euler = (0.3 * angle * i, angle if i else 0.1 * angle, -0.5 * angle)
            bone.keyframe_insert("rotation_euler", frame=frame)
    for frame, place in ((1, (0.0, 0.0, 0.0)), (12, (0.05, 0.0, 0.02))):
        armature.pose.bones["Root"].location = place
        armature.pose.bones["Root"].keyframe_insert("location", frame=frame)
    armature.animation_data.action.name = "Bend"


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(  # what the button Install from Disk calls
    filepath=ADDON,
    directory=str(Path(ADDON).parent),
    files=[{"name": Path(ADDON).name}],
    repo="user_default",
    enable_on_install=True,
)
facts = {"blender": bpy.app.version_string, "installed": hasattr(bpy.types.Scene, "deformrf")}
ops = bpy.ops.deformrf
facts["first panel"] = panel()
facts["no mesh"] = refused(ops.bind)
facts["no file"] = refused(ops.import_mesh, filepath=str(FOLDER / "missing.ply"))
(FOLDER / "cut.ply").write_bytes(Path(MESH).read_bytes()[:-5])
facts["cut file"] = refused(ops.import_mesh, filepath=str(FOLDER / "cut.ply"))
ops.import_mesh(filepath=MESH)
scene = bpy.context.scene
coarse = scene.deformrf.mesh
preview = next((child for child in coarse.children), None)
facts |= {"vertices": len(coarse.data.vertices), "edges": len(coarse.data.edges)}
facts["no skeleton"] = refused(ops.bind)
armature = skeleton(coarse)
facts["unbound"] = refused(ops.export_rig, filepath=str(FOLDER / "no.npz"))
ops.bind()
animate(armature)
scene.frame_set(12)
facts["check"] = refused(ops.check)
if preview is not None:
    posed, corners, weights = positions(coarse), [], []
    for i in range(4):
        for kind, values, dtype in (("corner", corners, np.int32), ("weight", weights, np.float32)):
            row = np.empty(len(preview.data.vertices), dtype)
            preview.data.attributes[f"{kind}{i}"].data.foreach_get("value", row)
            values.append(row)
    expected = np.einsum("kn,knx->nx", np.array(weights), posed[np.array(corners)])
    facts["preview error"] = float(np.abs(positions(preview) - expected).max())
    facts["preview moved"] = float(
        np.abs(expected - np.array([v.co for v in preview.data.vertices])).max()
    )
ops.export_rig(filepath=str(FOLDER / "rig.npz"))
ops.export_rig(filepath=str(FOLDER / "actions.npz"), clips="ACTIONS", with_vertices=False)
ops.export_cache(filepath=str(FOLDER / "rig.pc2"))
coarse.modifiers[0].use_deform_preserve_volume = True
ops.export_rig(filepath=str(FOLDER / "volume.npz"))
armature.pose.bones["Top"].scale = (1.2, 0.8, 1.1)
ops.export_rig(filepath=str(FOLDER / "scaled_volume.npz"))
coarse.modifiers[0].use_deform_preserve_volume = False
ops.export_rig(filepath=str(FOLDER / "scaled.npz"))
armature.pose.bones["Top"].scale = (1.0, 1.0, 1.0)
facts["last panel"] = panel()
ops.show(what="MESH")
ops.show(what="OBJECT")
ops.spread()

# A point cache of another program, played by Blender's own modifier.
if (FOLDER / "given.pc2").exists():
    for name in ("given.pc2", "given.mdd"):
        modifier = coarse.modifiers.new("cache", "MESH_CACHE")
        modifier.cache_format = name[-3:].upper()
        modifier.filepath = str(FOLDER / name)
        modifier.frame_start = 1.0
        frames = []
        for frame in range(1, 6):
            scene.frame_set(frame)
            frames.append(positions(coarse))
        np.save(FOLDER / f"{name}.npy", frames)
        coarse.modifiers.remove(modifier)

# Shape keys, a moved vertex, a lost vertex.
coarse.shape_key_add(name="Basis")
key = coarse.shape_key_add(name="Wide")
for point in key.data:
    point.co.x *= 1.2
key.value = 0.5
scene.frame_end = 2
ops.export_rig(filepath=str(FOLDER / "shape.npz"))
coarse.shape_key_clear()
coarse.data.vertices[3].co.x += 0.5
facts["moved"] = refused(ops.export_rig, filepath=str(FOLDER / "no.npz"))
coarse.data.vertices[3].co.x -= 0.5
for group in coarse.vertex_groups:
    group.remove([int(coarse.data.polygons[0].vertices[0])])
facts["no weight"] = refused(ops.export_rig, filepath=str(FOLDER / "no.npz"))
bpy.context.view_layer.objects.active = coarse
coarse.data.vertices.add(1)
facts["added"] = refused(ops.export_rig, filepath=str(FOLDER / "no.npz"))
bpy.ops.preferences.addon_disable(module=Path(ADDON).stem)
(FOLDER / "facts.json").write_text(json.dumps(facts))
sys.stdout.flush()
os._exit(0)  # bpy 4.2.0 crashes when Python ends, after any add-on that filters a list of objects
