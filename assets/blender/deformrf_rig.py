# SPDX-License-Identifier: MIT
"""deformrf rig: rig a deformrf model with Blender's tools, and take the rig back.

An add-on of one file for Blender 4.2 LTS and later: Edit > Preferences > Add-ons > Install from
Disk.  Its steps are in the 3D view's sidebar (N), tab "deformrf"; docs/rigs.md tells the whole
way and the fields of the file that Export writes.

The coarse mesh of tets has the vertices of the model, in its order.  The preview is what was
photographed; geometry nodes move its points with the corners of the tets that hold them, as the
model does when it is rendered.

Shapes: V vertices of the coarse mesh, T tets, B bones, K frames, S shape keys.
"""

import json
import struct
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, PointerProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper
from mathutils import Vector

bl_info = {
    "name": "deformrf rig",
    "author": "deformrf",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > deformrf",
    "description": "Rig a deformrf model: import its mesh, bind bones, export weights and clips",
    "category": "Rigging",
}

FORMAT, FORMAT_VERSION = "deformrf-blender", 1
ID, REST, TETS = "vertex_id", "deformrf_rest", "deformrf_tets"
MOVED = 1e-4  # of the mesh's size: rest vertices farther off were moved
ROUNDS, STILL = 5000, 1e-6  # of spreading weights; the change that ends it
PLY_TYPES = {"float": "<f4", "int": "<i4", "uchar": "u1"}
PLY_WIDTHS = {"face": 3, "tet": 4, "preview_face": 3}


# The file of deformrf rig export


def read_ply(path):
    """The elements of a PLY of deformrf rig export, as structured arrays by name."""
    data = Path(path).read_bytes()
    header, end, body = data.partition(b"end_header\n")
    lines = header.decode("ascii", "replace").splitlines()
    if not end or lines[:2] != ["ply", "format binary_little_endian 1.0"]:
        raise ValueError(f"{Path(path).name} is no PLY of deformrf rig export")
    elements, at = {}, 0
    for number, line in enumerate(lines):
        if not line.startswith("element "):
            continue
        name, count = line.split()[1], int(line.split()[2])
        kinds = []
        for row in lines[number + 1 :]:
            words = row.split()
            if words[0] != "property":
                break
            if words[1] == "list":
                kinds += [("count", "u1"), (words[4], "<i4", PLY_WIDTHS.get(name, 3))]
            else:
                kinds += [(words[2], PLY_TYPES[words[1]])]
        size = count * np.dtype(kinds).itemsize
        if count < 0 or at + size > len(body):
            raise ValueError(f"{Path(path).name} is cut off: export the model again")
        elements[name] = np.frombuffer(body, kinds, count, at)
        at += size
    if (
        not {"vertex", "face", "edge", "tet"} <= set(elements)
        or ID not in elements["vertex"].dtype.names
    ):
        raise ValueError(f"{Path(path).name} has no tets: make it with deformrf rig export")
    return elements


def columns(rows, *names):
    return np.column_stack([rows[name] for name in names])


def make_mesh(name, elements):
    """The object of the coarse mesh."""
    rows = elements["vertex"]
    rest = columns(rows, "x", "y", "z")
    pairs = columns(elements["edge"], "vertex1", "vertex2")
    mesh = bpy.data.meshes.new(name)
    faces = elements["face"]["vertex_indices"]
    mesh.from_pydata(rest.tolist(), pairs.tolist(), faces.tolist())
    if len(mesh.vertices) != len(rest) or len(mesh.edges) != len(pairs):
        raise ValueError(f"Blender changed the mesh: {len(mesh.edges)} of {len(pairs)} edges")
    mesh.attributes.new(ID, "INT", "POINT").data.foreach_set("value", rows[ID].astype(np.int32))
    mesh.attributes.new(REST, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", rest.ravel())
    mesh[TETS] = elements["tet"]["vertex_indices"].ravel().tolist()
    if "red" in rows.dtype.names:
        set_colors(mesh, columns(rows, "red", "green", "blue"))
    return bpy.data.objects.new(name, mesh)


def make_preview(name, elements, coarse):
    """The object that shows what was photographed, following the coarse mesh."""
    rows = elements["preview_vertex"]
    mesh = bpy.data.meshes.new(name)
    faces = elements["preview_face"]["vertex_indices"].tolist()
    mesh.from_pydata(columns(rows, "x", "y", "z").tolist(), [], faces)
    for i in range(4):
        for kind, attribute in (("corner", "INT"), ("weight", "FLOAT")):
            values = np.ascontiguousarray(rows[f"{kind}{i}"])
            mesh.attributes.new(f"{kind}{i}", attribute, "POINT").data.foreach_set("value", values)
    set_colors(mesh, columns(rows, "red", "green", "blue"))
    mesh.materials.append(shown_material())
    preview = bpy.data.objects.new(name, mesh)
    preview.parent = coarse
    preview.hide_select = True
    modifier = preview.modifiers.new("Follow the tets", "NODES")
    modifier.node_group = following_nodes()
    sockets = modifier.node_group.interface.items_tree
    modifier[next(s.identifier for s in sockets if s.name == "Coarse mesh")] = coarse
    return preview


def set_colors(mesh, colors):
    attribute = mesh.color_attributes.new("Color", "BYTE_COLOR", "POINT")
    rgba = np.column_stack([colors / 255.0, np.ones(len(colors))]).astype(np.float32)
    attribute.data.foreach_set("color_srgb", rgba.ravel())
    mesh.color_attributes.active_color = attribute


def shown_material():
    """The colors as they are, without light."""
    material = bpy.data.materials.get("deformrf colors")
    if material is None:
        material = bpy.data.materials.new("deformrf colors")
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        color = tree.nodes.new("ShaderNodeVertexColor")
        color.layer_name = "Color"
        light = tree.nodes.new("ShaderNodeEmission")
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(color.outputs["Color"], light.inputs["Color"])
        tree.links.new(light.outputs["Emission"], output.inputs["Surface"])
    return material


def following_nodes():
    """Position = sum of weight i times the position of corner i in the posed coarse mesh."""
    tree = bpy.data.node_groups.get("deformrf follow")
    if tree is not None:
        return tree
    tree = bpy.data.node_groups.new("deformrf follow", "GeometryNodeTree")
    tree.is_modifier = True
    for name, side, kind in (
        ("Geometry", "INPUT", "NodeSocketGeometry"),
        ("Coarse mesh", "INPUT", "NodeSocketObject"),
        ("Geometry", "OUTPUT", "NodeSocketGeometry"),
    ):
        tree.interface.new_socket(name, in_out=side, socket_type=kind)
    node, link = tree.nodes.new, tree.links.new
    given, result = node("NodeGroupInput"), node("NodeGroupOutput")
    coarse, position = node("GeometryNodeObjectInfo"), node("GeometryNodeInputPosition")
    link(given.outputs["Coarse mesh"], coarse.inputs["Object"])
    total = None
    for i in range(4):
        corner = named(node("GeometryNodeInputNamedAttribute"), "INT", f"corner{i}")
        weight = named(node("GeometryNodeInputNamedAttribute"), "FLOAT", f"weight{i}")
        sample = node("GeometryNodeSampleIndex")
        sample.data_type = "FLOAT_VECTOR"
        link(coarse.outputs["Geometry"], sample.inputs["Geometry"])
        link(position.outputs[0], enabled(sample.inputs, "Value"))
        link(enabled(corner.outputs, "Attribute"), sample.inputs["Index"])
        scaled = node("ShaderNodeVectorMath")
        scaled.operation = "SCALE"
        link(enabled(sample.outputs, "Value"), scaled.inputs[0])
        link(enabled(weight.outputs, "Attribute"), scaled.inputs["Scale"])
        if total is not None:
            added = node("ShaderNodeVectorMath")
            link(total.outputs[0], added.inputs[0])
            link(scaled.outputs[0], added.inputs[1])
        total = scaled if total is None else added
    placed = node("GeometryNodeSetPosition")
    link(given.outputs["Geometry"], placed.inputs["Geometry"])
    link(total.outputs[0], placed.inputs["Position"])
    link(placed.outputs["Geometry"], result.inputs["Geometry"])
    return tree


def named(node, kind, name):
    node.data_type = kind
    node.inputs["Name"].default_value = name
    return node


def enabled(sockets, name):
    """Of the sockets with that name, one for each type in older versions, the one in use."""
    return next(socket for socket in sockets if socket.name == name and socket.enabled)


# The coarse mesh, its weights and its poses


def model_order(obj):
    """The mesh's vertices in the model's order, and the model's vertices at rest [V, 3].

    Raises:
        ValueError: Vertices were added, deleted or moved.
    """
    mesh = obj.data
    if ID not in mesh.attributes or REST not in mesh.attributes or TETS not in mesh:
        raise ValueError(f"{obj.name} is no coarse mesh: import one with step 1")
    count = max(mesh[TETS]) + 1
    ids = np.empty(len(mesh.vertices), np.int32)
    mesh.attributes[ID].data.foreach_get("value", ids)
    order = np.argsort(ids, kind="stable")
    if len(ids) != count or (ids[order] != np.arange(count)).any():
        raise ValueError(
            f"{obj.name} has {len(ids)} vertices, the model {count}: vertices were added, merged "
            "or deleted; undo that, or import the mesh again"
        )
    rest = np.empty(3 * count, np.float32)
    mesh.attributes[REST].data.foreach_get("vector", rest)
    rest = rest.reshape(-1, 3)
    now = np.empty(3 * count, np.float32)
    if mesh.shape_keys:
        mesh.shape_keys.reference_key.data.foreach_get("co", now)
    else:
        mesh.vertices.foreach_get("co", now)
    moved = np.abs(now.reshape(-1, 3) - rest).max(axis=1) > MOVED * np.ptp(rest)
    if moved.any():
        raise ValueError(
            f"{moved.sum()} vertices of {obj.name} were moved in edit mode: what lies there at "
            "rest belongs to the model; undo that, and use a shape key to change the form"
        )
    return order, rest[order]


def surface_ids(mesh):
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    return np.unique(corners)


def exported_bones(armature):
    """Bones that deform, and their ancestors; parents first."""
    wanted = set()
    for bone in armature.data.bones:
        if bone.use_deform:
            wanted.update((bone.name, *(parent.name for parent in bone.parent_recursive)))
    ordered = [bone for bone in armature.data.bones if bone.name in wanted]
    ordered.sort(key=lambda bone: len(bone.parent_recursive))
    if not ordered:
        raise ValueError(f"{armature.name} has no bones that deform")
    return ordered


def weights_of(obj, bones):
    """Blender's weights, rows normalized as the Armature modifier does.  [V, B] mesh order"""
    column = {bone.name: i for i, bone in enumerate(bones) if bone.use_deform}
    by_group = {g.index: column[g.name] for g in obj.vertex_groups if g.name in column}
    weights = np.zeros((len(obj.data.vertices), len(bones)))
    for vertex in obj.data.vertices:
        for group in vertex.groups:
            if group.group in by_group:
                weights[vertex.index, by_group[group.group]] = group.weight
    sums = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, sums, out=np.zeros_like(weights), where=sums > 0.0)


def set_weights(obj, bones, weights):
    for i, bone in enumerate(bones):
        group = obj.vertex_groups.get(bone.name)
        if group is not None:
            obj.vertex_groups.remove(group)
        ids = np.flatnonzero(weights[:, i] > 1e-5)
        if len(ids) and bone.use_deform:
            group = obj.vertex_groups.new(name=bone.name)
            for vertex in ids.tolist():
                group.add([vertex], float(weights[vertex, i]), "REPLACE")


def spread_inside(mesh, weights, known):
    """Weights of the other vertices as means of their neighbors along the tets' edges.  [V, B]

    The harmonic extension: smooth, and never outside of what the surface has.
    """
    ends = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", ends)
    ends = ends.reshape(-1, 2)
    here, there = np.concatenate([ends, ends[:, ::-1]]).T
    free = np.setdiff1d(np.arange(len(weights)), known)
    keep = np.isin(here, free)
    order = np.argsort(here[keep], kind="stable")
    here, there = here[keep][order], there[keep][order]
    starts = np.searchsorted(here, free)
    counts = np.diff(np.append(starts, len(here)))[:, None]
    weights = weights.copy()
    if len(free) == 0:
        return weights
    weights[free] = weights[known].mean(axis=0)
    for _ in range(ROUNDS):
        new = np.add.reduceat(weights[there], starts, axis=0) / counts
        change = np.abs(new - weights[free]).max()
        weights[free] = new
        if change < STILL:
            break
    return weights


def near_weights(points, bones, to_mesh):
    """Weights by the distance from bones, where Blender's own method fails.  [N, B]"""
    distances = np.full((len(points), len(bones)), np.inf)
    for i, bone in enumerate(bones):
        if bone.use_deform:
            head, tail = (np.array(to_mesh @ p) for p in (bone.head_local, bone.tail_local))
            along = tail - head
            share = (points - head) @ along / max(along @ along, 1e-12)
            nearest = head + np.clip(share, 0.0, 1.0)[:, None] * along
            distances[:, i] = np.linalg.norm(points - nearest, axis=1)
    weights = 1.0 / np.maximum(distances, 1e-6) ** 4
    return weights / weights.sum(axis=1, keepdims=True)


def armature_modifier(obj):
    found = [m for m in obj.modifiers if m.type == "ARMATURE" and m.object is not None]
    if len(found) != 1:
        raise ValueError(f"{obj.name} has {len(found)} Armature modifiers, it needs one: bind it")
    return found[0]


def posed_vertices(context, obj):
    """The vertices after all modifiers, in the mesh's own space and order.  [V, 3] float32"""
    posed = obj.evaluated_get(context.evaluated_depsgraph_get())
    mesh = posed.to_mesh()
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", vertices)
    posed.to_mesh_clear()
    if len(vertices) != 3 * len(obj.data.vertices):
        names = ", ".join(m.name for m in obj.modifiers if m.type != "ARMATURE")
        raise ValueError(f"a modifier of {obj.name} changes its vertices' number: remove {names}")
    return vertices.reshape(-1, 3)


def matrix(values):
    return np.array(values, np.float64)


def bone_matrices(context, obj, armature, bones):
    """The bones' rest frames and skinning matrices in the mesh's space.  Two [B, 4, 4]"""
    depsgraph = context.evaluated_depsgraph_get()
    posed = armature.evaluated_get(depsgraph)
    mesh_world = matrix(obj.evaluated_get(depsgraph).matrix_world)
    to_mesh = np.linalg.inv(mesh_world) @ matrix(posed.matrix_world)
    rest = np.array([to_mesh @ matrix(bone.matrix_local) for bone in bones])
    now = np.array([to_mesh @ matrix(posed.pose.bones[bone.name].matrix) for bone in bones])
    return rest, now @ np.linalg.inv(rest)


def rigid(frames):
    """Rest frames without the scale that the armature object may have."""
    u, _, vt = np.linalg.svd(frames[:, :3, :3])
    frames = frames.copy()
    frames[:, :3, :3] = u @ vt
    return frames


def volumes(vertices, tets):
    a, b, c, d = (vertices[tets[:, i]].astype(float) for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def actions_of(armature):
    """The actions that an armature can play."""
    for action in bpy.data.actions:
        if hasattr(action, "slots"):  # Blender 4.4 and later
            if any(slot.target_id_type == "OBJECT" for slot in action.slots):
                yield action
        elif action.id_root == "OBJECT":
            yield action


def play(armature, action):
    animation = armature.animation_data or armature.animation_data_create()
    animation.action = action
    if action is not None and hasattr(animation, "action_slot") and animation.action_slot is None:
        suitable = [s for s in action.slots if s.target_id_type == "OBJECT"]
        animation.action_slot = suitable[0] if suitable else None


def sampled(context, obj, armature, bones, frames, order, with_vertices):
    """What a clip stores: matrices [K, B, 4, 4], shape key values [K, S], vertices or None."""
    matrices, values, vertices = [], [], []
    keys = obj.data.shape_keys.key_blocks[1:] if obj.data.shape_keys else []
    for frame in frames:
        context.scene.frame_set(frame)
        matrices.append(bone_matrices(context, obj, armature, bones)[1])
        values.append([0.0 if key.mute else key.value for key in keys])
        if with_vertices:
            vertices.append(posed_vertices(context, obj)[order])
    values = np.array(values, np.float32).reshape(len(frames), len(keys))
    return np.array(matrices), values, np.array(vertices, np.float32) if with_vertices else None


def shape_offsets(obj, order):
    """How each shape key moves the vertices.  [S, V, 3]"""
    keys = obj.data.shape_keys
    if not keys:
        return [], np.zeros((0, len(order), 3), np.float32)
    offsets = []
    for key in keys.key_blocks[1:]:
        pair = []
        for block in (key, key.relative_key):
            place = np.empty(3 * len(order), np.float32)
            block.data.foreach_get("co", place)
            pair.append(place.reshape(-1, 3)[order])
        offsets.append(pair[0] - pair[1])
    return [key.name for key in keys.key_blocks[1:]], np.array(offsets).reshape(-1, len(order), 3)


def export_rig(context, obj, path, clips="SCENE", with_vertices=True):
    """Write weights, bones, clips and shape keys; returns what was written, in words."""
    order, rest_vertices = model_order(obj)
    modifier = armature_modifier(obj)
    armature = modifier.object
    bones = exported_bones(armature)
    number = {bone.name: i for i, bone in enumerate(bones)}
    weights = weights_of(obj, bones)
    outside = surface_ids(obj.data)
    bare = outside[weights[outside].sum(axis=1) == 0.0]
    if len(bare):
        raise ValueError(
            f"{len(bare)} vertices of the surface have no weight, the first is {bare[0]}: no bone "
            "would move them; paint them, or bind again"
        )
    scene = context.scene
    before = scene.frame_current
    animation = armature.animation_data
    action_before = animation.action if animation else None
    names, offsets = shape_offsets(obj, order)
    fps = scene.render.fps / scene.render.fps_base
    stored, arrays = [], {}
    try:
        wanted = [(None, scene.name, (scene.frame_start, scene.frame_end))]
        if action_before is not None:
            wanted = [(action_before, action_before.name, wanted[0][2])]
        if clips == "ACTIONS":
            wanted = [(a, a.name, a.frame_range) for a in actions_of(armature)]
            if not wanted:
                raise ValueError(f"{armature.name} has no actions: choose the scene's frames")
        for i, (action, name, (first, last)) in enumerate(wanted):
            if action is not None:
                play(armature, action)
            frames = range(round(first), round(last) + 1)
            matrices, values, vertices = sampled(
                context, obj, armature, bones, frames, order, with_vertices
            )
            arrays[f"times_{i}"] = np.arange(len(frames)) / fps
            arrays[f"matrices_{i}"], arrays[f"shape_values_{i}"] = matrices, values
            if with_vertices:
                arrays[f"vertices_{i}"] = vertices
            stored.append(name)
        rest, _ = bone_matrices(context, obj, armature, bones)
    finally:
        if clips == "ACTIONS":
            play(armature, action_before)
        scene.frame_set(before)
    to_mesh = np.linalg.inv(matrix(obj.matrix_world)) @ matrix(armature.matrix_world)
    ends = np.array([[(*b.head_local, 1.0), (*b.tail_local, 1.0)] for b in bones]) @ to_mesh.T
    meta = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "blender": bpy.app.version_string,
        "bones": [bone.name for bone in bones],
        "clips": stored,
        "shape_keys": names,
        "preserve_volume": bool(modifier.use_deform_preserve_volume),
    }
    arrays |= {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "rest_vertices": rest_vertices,
        "weights": weights[order].astype(np.float32),
        "bone_parents": np.array([number[b.parent.name] if b.parent else -1 for b in bones], "i4"),
        "bone_rest": rigid(rest),
        "bone_heads": ends[:, 0, :3],
        "bone_tails": ends[:, 1, :3],
        "shape_keys": offsets.astype(np.float32),
    }
    with open(path, "wb") as stream:
        np.savez(stream, **arrays)
    return f"{len(bones)} bones, {len(order)} vertices, clips: {', '.join(stored)}"


def export_cache(context, obj, path):
    """Write the posed vertices of the scene's frames as PC2."""
    order, _ = model_order(obj)
    scene = context.scene
    before, frames = scene.frame_current, range(scene.frame_start, scene.frame_end + 1)
    try:
        with open(path, "wb") as stream:
            head = (b"POINTCACHE2\0", 1, len(order), float(scene.frame_start), 1.0, len(frames))
            stream.write(struct.pack("<12siiffi", *head))
            for frame in frames:
                scene.frame_set(frame)
                stream.write(posed_vertices(context, obj)[order].astype("<f4").tobytes())
    finally:
        scene.frame_set(before)
    return f"{len(frames)} frames of {len(order)} vertices, {scene.render.fps} frames a second"


# Operators: the panel's buttons


class Step:
    """A button whose errors are Blender's reports."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context):
        try:
            self.report({"INFO"}, self.work(context))
        except OSError as error:
            self.report({"ERROR"}, f"{error.filename}: {error.strerror}")
            return {"CANCELLED"}
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def chosen(context, what):
    found = getattr(context.scene.deformrf, what)
    if found is None:
        raise ValueError("import a coarse mesh first" if what == "mesh" else "choose an armature")
    return found


def only(context, active, *others):
    """Object mode, with these objects selected."""
    if context.object is not None and context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for obj in list(context.selected_objects):
        obj.select_set(False)
    for obj in (*others, active):
        obj.hide_set(False)
        obj.select_set(True)
    context.view_layer.objects.active = active


class DEFORMRF_OT_import(Step, bpy.types.Operator, ImportHelper):
    """Import the coarse mesh, and what was photographed, from a file of deformrf rig export"""

    bl_idname = "deformrf.import_mesh"
    bl_label = "Import coarse mesh"
    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})

    def work(self, context):
        elements = read_ply(self.filepath)
        name = Path(self.filepath).stem
        obj = make_mesh(name, elements)
        collection = bpy.data.collections.new(name)
        context.scene.collection.children.link(collection)
        collection.objects.link(obj)
        if "preview_vertex" in elements:
            collection.objects.link(make_preview(f"{name} preview", elements, obj))
        context.scene.deformrf.mesh = obj
        obj.display_type = "WIRE"
        only(context, obj)
        for window in context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.spaces.active.shading.color_type = "VERTEX"
        return f"{len(obj.data.vertices)} vertices, {len(elements['tet'])} tets"


class DEFORMRF_OT_skeleton(Step, bpy.types.Operator):
    """Add an armature with one bone through the object; extrude (E) further bones from it"""

    bl_idname = "deformrf.add_skeleton"
    bl_label = "New skeleton"

    def work(self, context):
        obj = chosen(context, "mesh")
        corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle = 0.5 * (low + high)
        data = bpy.data.armatures.new(f"{obj.name} skeleton")
        armature = bpy.data.objects.new(data.name, data)
        obj.users_collection[0].objects.link(armature)
        armature.show_in_front = True
        only(context, armature)
        bpy.ops.object.mode_set(mode="EDIT")
        bone = data.edit_bones.new("Root")
        bone.head = (*middle[:2], low[2])
        bone.tail = (*middle[:2], middle[2])
        context.scene.deformrf.armature = armature
        return "One bone: extrude more from its tip (E), then Tab and bind"


class DEFORMRF_OT_bind(Step, bpy.types.Operator):
    """Bind the mesh to the armature: Blender's automatic weights outside, smooth weights inside"""

    bl_idname = "deformrf.bind"
    bl_label = "Bind"

    def work(self, context):
        obj, armature = chosen(context, "mesh"), chosen(context, "armature")
        order, rest = model_order(obj)
        bones = exported_bones(armature)
        for modifier in [m for m in obj.modifiers if m.type == "ARMATURE"]:
            obj.modifiers.remove(modifier)
        set_weights(obj, bones, np.zeros((len(order), len(bones))))
        only(context, armature, obj)
        bpy.ops.object.parent_set(type="ARMATURE_AUTO")
        weights, outside = weights_of(obj, bones), surface_ids(obj.data)
        way = "Blender's automatic weights"
        if (weights[outside].sum(axis=1) == 0.0).any():
            way = "weights by distance (Blender's automatic weights found no solution)"
            place = np.empty_like(rest)
            place[order] = rest
            to_mesh = obj.matrix_world.inverted() @ armature.matrix_world
            weights[outside] = near_weights(place[outside], bones, to_mesh)
        set_weights(obj, bones, spread_inside(obj.data, weights, outside))
        only(context, obj)
        return f"Bound to {len(bones)} bones: {way}, smooth inside"


class DEFORMRF_OT_spread(Step, bpy.types.Operator):
    """After painting: give the vertices inside smooth weights between those of the surface"""

    bl_idname = "deformrf.spread"
    bl_label = "Spread weights inside"

    def work(self, context):
        obj = chosen(context, "mesh")
        bones = exported_bones(armature_modifier(obj).object)
        weights, outside = weights_of(obj, bones), surface_ids(obj.data)
        if (weights[outside].sum(axis=1) == 0.0).any():
            raise ValueError("vertices of the surface have no weight: paint them first")
        set_weights(obj, bones, spread_inside(obj.data, weights, outside))
        return f"{len(weights) - len(outside)} vertices inside have new weights"


class DEFORMRF_OT_show(Step, bpy.types.Operator):
    """Show the object, or the coarse mesh alone to paint weights on it"""

    bl_idname = "deformrf.show"
    bl_label = "Show"
    what: EnumProperty(items=[("OBJECT", "Object", ""), ("MESH", "Coarse mesh", "")])

    def work(self, context):
        obj = chosen(context, "mesh")
        obj.display_type = "WIRE" if self.what == "OBJECT" else "TEXTURED"
        for child in obj.children:
            if "corner0" in getattr(child.data, "attributes", ()):
                child.hide_set(self.what == "MESH")
        return f"The {self.what.lower()} is shown"


class DEFORMRF_OT_check(Step, bpy.types.Operator):
    """Look for tets that the pose turns inside out; the 3D cursor goes to the worst one"""

    bl_idname = "deformrf.check"
    bl_label = "Check this pose"

    def work(self, context):
        obj = chosen(context, "mesh")
        order, rest = model_order(obj)
        tets = np.array(obj.data[TETS], np.int32).reshape(-1, 4)
        posed = posed_vertices(context, obj)[order]
        ratios = volumes(posed, tets) / volumes(rest, tets)
        worst = int(ratios.argmin())
        place = Vector(posed[tets[worst]].mean(axis=0).tolist())
        context.scene.cursor.location = obj.matrix_world @ place
        inverted = int((ratios <= 0.0).sum())
        words = f"the smallest tet has {ratios[worst]:.2f} of its volume (3D cursor)"
        if inverted:
            raise ValueError(f"{inverted} tets are inside out, {words}: smooth the weights there")
        return f"No tet is inside out; {words}"


class DEFORMRF_OT_export(Step, bpy.types.Operator, ExportHelper):
    """Write weights, bones, clips and shape keys for deformrf rig import"""

    bl_idname = "deformrf.export_rig"
    bl_label = "Export rig"
    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})
    clips: EnumProperty(
        name="Clips",
        items=[
            (
                "SCENE",
                "Scene's frames",
                "One clip, what plays from the scene's first frame to its last",
            ),
            ("ACTIONS", "All actions", "A clip for each action that the armature can play"),
        ],
    )
    with_vertices: BoolProperty(
        name="Posed vertices",
        description="Also every frame's vertices as Blender poses them: deformrf compares with "
        "them, and takes them where bones alone don't tell the pose (shape keys, other modifiers)",
        default=True,
    )

    def work(self, context):
        obj = chosen(context, "mesh")
        return export_rig(context, obj, self.filepath, self.clips, self.with_vertices)


class DEFORMRF_OT_export_cache(Step, bpy.types.Operator, ExportHelper):
    """Write every frame's vertices as a PC2 point cache: any animation, without bones"""

    bl_idname = "deformrf.export_cache"
    bl_label = "Export point cache"
    filename_ext = ".pc2"
    filter_glob: StringProperty(default="*.pc2", options={"HIDDEN"})

    def work(self, context):
        return export_cache(context, chosen(context, "mesh"), self.filepath)


class DEFORMRF_PT_panel(bpy.types.Panel):
    """The steps in order"""

    bl_idname = "DEFORMRF_PT_panel"
    bl_label = "deformrf"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "deformrf"

    def draw(self, context):
        settings = context.scene.deformrf
        mesh, armature = settings.mesh, settings.armature
        bound = mesh is not None and any(m.type == "ARMATURE" for m in mesh.modifiers)

        def step(title, done, ready=True):
            box = self.layout.box()
            box.label(text=title, icon="CHECKMARK" if done else "DOT")
            column = box.column(align=True)
            column.enabled = ready
            return column

        column = step("1  Mesh", mesh is not None)
        column.operator(DEFORMRF_OT_import.bl_idname, icon="IMPORT")
        column.prop(settings, "mesh", text="")
        column = step("2  Skeleton", armature is not None, mesh is not None)
        column.operator(DEFORMRF_OT_skeleton.bl_idname, icon="ARMATURE_DATA")
        column.prop(settings, "armature", text="")
        column = step("3  Weights", bound, None not in (mesh, armature))
        column.operator(DEFORMRF_OT_bind.bl_idname, icon="LINKED")
        row = column.row(align=True)
        for what, text in (("OBJECT", "See object"), ("MESH", "Paint mesh")):
            row.operator(DEFORMRF_OT_show.bl_idname, text=text).what = what
        column.operator(DEFORMRF_OT_spread.bl_idname, icon="MOD_SMOOTH")
        column = step("4  Pose and animate", False, bound)
        column.label(text="In pose mode, with keys as ever")
        column.operator(DEFORMRF_OT_check.bl_idname, icon="VIEWZOOM")
        column = step("5  Back to deformrf", False, bound)
        column.operator(DEFORMRF_OT_export.bl_idname, icon="EXPORT")
        column.operator(DEFORMRF_OT_export_cache.bl_idname, icon="EXPORT")


def is_coarse_mesh(_, obj):
    return obj.type == "MESH" and TETS in obj.data


def is_armature(_, obj):
    return obj.type == "ARMATURE"


class DeformrfSettings(bpy.types.PropertyGroup):
    mesh: PointerProperty(name="Coarse mesh", type=bpy.types.Object, poll=is_coarse_mesh)
    armature: PointerProperty(name="Armature", type=bpy.types.Object, poll=is_armature)


CLASSES = (
    DeformrfSettings,
    DEFORMRF_OT_import,
    DEFORMRF_OT_skeleton,
    DEFORMRF_OT_bind,
    DEFORMRF_OT_spread,
    DEFORMRF_OT_show,
    DEFORMRF_OT_check,
    DEFORMRF_OT_export,
    DEFORMRF_OT_export_cache,
    DEFORMRF_PT_panel,
)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.deformrf = PointerProperty(type=DeformrfSettings)


def unregister():
    del bpy.types.Scene.deformrf
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
