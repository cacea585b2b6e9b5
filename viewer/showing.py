"""A model in the window, in the place of the one that was shown before."""

import gc
import time
from concurrent.futures import ThreadPoolExecutor

from . import preferences
from .document import autosave_folder, left_behind, start_of
from .layers import (
    BoneLayer,
    HandleLayer,
    MarkLayer,
    MeshLayer,
    Photographed,
    RadianceLayer,
    choose_path,
)
from .loading import Progress, prepare
from .tools import Controls, Fly


def load(app, field, name: str, device: str, interop: str = "auto") -> None:
    """Show a model, in the place of an older one if all goes well.

    This takes a while, above all where kernels have to be compiled.

    Raises:
        ValueError: interop is "buffer", and CUDA and OpenGL share no buffers.
    """
    path = choose_path(app.ctx, device, interop)
    app.progress = Progress(device)
    arguments = field, name, device, app.progress
    if app.gui is None:
        scene, renderer = prepare(*arguments)
    else:
        with ThreadPoolExecutor(1) as pool, app.only_shown():
            preparing = pool.submit(prepare, *arguments)
            while not preparing.done():
                app.show_alone(app.panels.loading_window, f"preparing {name}", app.progress)
                time.sleep(0.05)
            scene, renderer = preparing.result()
    app.usual_fps = scene.settings.target_fps
    is_first = app.scene is None
    if is_first:
        preferences.apply(app.preferences, scene.settings)
        scene.settings.show_floor = app.gui is not None
    else:
        scene.settings = app.scene.settings
    show(app, scene, renderer, path)
    if not is_first:
        gc.unfreeze()
        gc.collect()  # the one before
    gc.freeze()  # or Python would look through all of it in the middle of a drag, for 0.1 s
    app.loaded_on = device, interop
    if app.watcher.over:
        app.train_job = None
    if app.gui is not None:
        app.end()
        app.questions.left_behind = left_behind(autosave_folder(), field.mesh)
        app.begin_autosave()


def show(app, scene, renderer, path: str) -> None:
    """Show a scene from now on, in the place of the one before.

    Args:
        renderer: Of the scene's field.
        path: How frames reach OpenGL, as upload.choose_path says.
    """
    noted = dict.fromkeys(app.window.event_types, app._note_event)
    noted["on_mouse_drag"] = app._note_drag
    panels_first = [] if app.gui is None else [app.gui]
    radiance = RadianceLayer(app.ctx, scene, renderer, path, app.times)
    handle_layer = HandleLayer(app.ctx, scene)
    bone_layer = BoneLayer(app.ctx, scene)
    if app.scene is not None:
        app.fly.end()
        app.controls.cancel()
        app.window.remove_handlers(**noted)
        app.window.remove_handlers(*panels_first)
        app.window.remove_handlers(app.controls)
        for layer in (
            app.radiance,
            app.mesh_layer,
            app.handle_layer,
            app.bone_layer,
            app.mark_layer,
        ):
            layer.release()
    app.radiance, app.handle_layer, app.bone_layer = radiance, handle_layer, bone_layer
    app.mark_layer, app.photographed = MarkLayer(app.ctx), Photographed(scene, renderer.device)
    scene.settings.show_photographed = False
    app.mesh_layer = MeshLayer(app.ctx, scene, radiance.draw_depth)
    say = app.recorder.say
    app.controls = Controls(scene, app.radiance.depth_image, app.log, say)
    app.photographs = None  # of the scene's data set, if its folder was given
    app.fly = Fly(app.window, app.controls)
    app.scene, app.session_start, app.project = scene, start_of(scene), None
    app.takes.forget()
    # The handlers that are pushed last are asked first.
    app.window.push_handlers(app.controls)
    app.window.push_handlers(*panels_first)
    app.window.push_handlers(**noted)
    app._note_event()  # panels are built, also in the middle of a drag
