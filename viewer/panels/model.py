"""What is shown: the model and where it came from."""

from imgui_bundle import imgui


def model_panel(scene, actions, status):
    mesh, options, meta = scene.field.mesh, scene.field.options, scene.field.meta
    imgui.text(scene.name)
    imgui.text_disabled(
        f"{mesh.tet_count:,} tets, {mesh.vertex_count:,} vertices, {options.level_count} levels"
    )
    psnr = (meta.get("test_mean") or {}).get("psnr")
    if psnr is not None:
        imgui.text_disabled(f"{psnr:.1f} dB on its test views")
