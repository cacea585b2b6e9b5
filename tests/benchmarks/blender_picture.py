"""The picture of docs/rigs.md: the bundled model in Blender, with three bones, at rest and bent.

    deformrf rig export assets/helmet.npz -o helmet.ply
    PYTHON tests/benchmarks/blender_picture.py helmet.ply docs/figures/blender.png

PYTHON is a Python that imports bpy.  What is drawn is what the add-on shows: the preview, the
coarse mesh's surface as wires, and the bones.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

ADDON = Path(__file__).resolve().parents[2] / "assets" / "blender" / "deformrf_rig.py"
MESH, PICTURE = sys.argv[-2:]
WIRES, BONES = (0.05, 0.35, 0.7), (1.0, 0.45, 0.05)
IN_FRONT = -0.8  # y of the bones, which would be hidden in the object
BEND = {"Middle": (0.0, 0.0, 0.5), "Top": (0.2, 0.0, 0.6)}  # Euler angles


def plain(color):
    """A material of one color, without light."""
    material = bpy.data.materials.new("plain")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    light, output = (tree.nodes.new(f"ShaderNode{n}") for n in ("Emission", "OutputMaterial"))
    light.inputs[0].default_value = (*color, 1.0)
    tree.links.new(light.outputs[0], output.inputs[0])
    return material


def place(name, data, shift):
    obj = bpy.data.objects.new(name, data)
    obj.location = shift
    bpy.context.scene.collection.objects.link(obj)
    return obj


def rig(scene):
    """Three bones along the height, bound."""
    bpy.ops.deformrf.import_mesh(filepath=MESH)
    bpy.ops.deformrf.add_skeleton()
    mesh, armature = scene.deformrf.mesh, scene.deformrf.armature
    corners = np.array([v.co for v in mesh.data.vertices])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, heights = 0.5 * (low + high), np.linspace(low[2], high[2], 4)
    last = armature.data.edit_bones["Root"]
    last.head, last.tail = (*middle[:2], heights[0]), (*middle[:2], heights[1])
    for name, height in zip(("Middle", "Top"), heights[2:], strict=True):
        bone = armature.data.edit_bones.new(name)
        bone.head, bone.tail = last.tail, (*middle[:2], height)
        bone.parent, bone.use_connect = last, True
        last = bone
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.deformrf.bind()
    return mesh, armature


def draw(mesh, armature, shift, wires=None):
    """A copy of what is seen now, moved along x."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    preview = mesh.children[0].evaluated_get(depsgraph)
    place("preview", bpy.data.meshes.new_from_object(preview), (shift, 0.0, 0.0))
    if wires is not None:
        posed = bpy.data.meshes.new_from_object(mesh.evaluated_get(depsgraph))
        surface = bpy.data.meshes.new("surface")
        faces = [tuple(polygon.vertices) for polygon in posed.polygons]
        surface.from_pydata([tuple(v.co) for v in posed.vertices], [], faces)
        surface.materials.append(wires)
        modifier = place("wires", surface, (shift, 0.0, 0.0)).modifiers.new("wires", "WIREFRAME")
        modifier.thickness = 0.0022
    for bone in armature.pose.bones:
        curve = bpy.data.curves.new("bone", "CURVE")
        curve.dimensions, curve.bevel_depth = "3D", 0.008
        line = curve.splines.new("POLY")
        line.points.add(1)
        for point, end in zip(line.points, (bone.head, bone.tail), strict=True):
            at = armature.matrix_world @ end
            point.co = (*at, 1.0)
            bpy.ops.mesh.primitive_uv_sphere_add(
                radius=0.018, location=(at.x + shift, at.y + IN_FRONT, at.z)
            )
            bpy.context.object.data.materials.append(bone_color)
        curve.materials.append(bone_color)
        place("bone", curve, (shift, IN_FRONT, 0.0))


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_install(filepath=str(ADDON), overwrite=True)
bpy.ops.preferences.addon_enable(module=ADDON.stem)
scene = bpy.context.scene
mesh, armature = rig(scene)
wire_color, bone_color = plain(WIRES), plain(BONES)
draw(mesh, armature, 0.0, wire_color)
for name, angles in BEND.items():
    armature.pose.bones[name].rotation_mode = "XYZ"
    armature.pose.bones[name].rotation_euler = angles
bpy.context.view_layer.update()
draw(mesh, armature, 0.75, wire_color)
draw(mesh, armature, 1.55)
for obj in (mesh, armature, *mesh.children):
    obj.hide_render = True
camera = bpy.data.cameras.new("camera")
camera.type, camera.ortho_scale = "ORTHO", 2.2
scene.camera = place("camera", camera, (1.27, -4.0, 0.52))
scene.camera.rotation_euler = (0.5 * np.pi, 0.0, 0.0)
scene.world = bpy.data.worlds.new("world")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.9, 0.9, 0.9, 1.0)
scene.render.engine, scene.cycles.samples = "CYCLES", 16
scene.render.resolution_x, scene.render.resolution_y = 960, 420
scene.view_settings.view_transform = "Standard"
scene.render.image_settings.compression = 100
scene.render.filepath = PICTURE
bpy.ops.render.render(write_still=True)
