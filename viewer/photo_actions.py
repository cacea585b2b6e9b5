"""Actions that jump to the cameras of a data set's photographs; photographs.py reads them."""

from pathlib import Path

WITHOUT = "there are no photographs: give the data set's folder with --data, or drop it here"


def open_photographs(app, folder: Path) -> None:
    """Take the photographs of the scene's data set from its folder.

    Raises:
        DatasetError: The folder is no data set, or has no photograph.
    """
    from .photographs import Photographs

    app.photographs = Photographs(folder, app.scene.field.world_to_model)
    app.recorder.say(f"{len(app.photographs)} photographs: [ and ] jump to their cameras")


def line_of(photographs) -> str:
    """Which one is looked at."""
    if photographs.shown is None:
        return f"{len(photographs)} photographs"
    return f"{photographs.index + 1} of {len(photographs)}: {photographs.shown.name}"


def _jump(by):
    """A function that moves the camera to another photograph's."""

    def jump(app):
        photographs, settings = app.photographs, app.scene.settings
        if photographs is None:
            app.recorder.say(WITHOUT)
            return
        try:
            photographs.step(by)
        except (OSError, ValueError) as error:  # a DatasetError is one
            app.recorder.say(str(error))
            return
        show_photograph(app, "over" if settings.photograph == "hidden" else settings.photograph)
        app.recorder.say(photographs.says())

    return jump


def show_photograph(app, where: str) -> None:
    """Show the one that was read over the render, beside it, or not, and look from its camera."""
    scene, controls = app.scene, app.controls
    scene.settings.photograph = where
    photograph = app.photographs.shown
    if photograph is None or where == "hidden":
        return
    from .photographs import places, seen_from

    app.fly.end()
    room = places(controls.size, controls.ratio, scene.settings).room
    scene.orbit = seen_from(photograph, scene.orbit, room, controls.size[1], scene.center)


PHOTO_ACTIONS = {"next_photograph": _jump(1), "previous_photograph": _jump(-1)}


def placed_photograph(app):
    """The photograph that is to be drawn, or None, and its Places; the view's axis moves there.

    One over the render is drawn as long as the camera is where it was taken.
    """
    controls, settings = app.controls, app.scene.settings
    controls.axis = None
    photograph = None if app.photographs is None else app.photographs.shown
    if photograph is None or settings.photograph == "hidden":
        return None, None
    from .photographs import is_seen_from, places, seen_from

    scene, where = app.scene, places(controls.size, controls.ratio, settings)
    if is_seen_from(photograph, scene.orbit):  # the window or the panel may have another size
        room, height = where.room, controls.size[1]
        scene.orbit = seen_from(photograph, scene.orbit, room, height, scene.center)
    elif settings.photograph == "over":
        return None, None
    controls.axis = where.render
    return photograph, where
