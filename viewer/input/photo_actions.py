"""Actions that jump to the cameras of a data set's photographs; photographs.py reads them."""

from ..settings import PHOTOGRAPHS

WITHOUT = "there are no photographs: give the data set's folder with --data, or drop it here"


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
    app.scene.settings.photograph = where
    photograph = app.photographs.shown
    if photograph is None or where == "hidden":
        return
    app.fly.end()
    _look_from(app, photograph, _places(app))


def _place(app):
    if app.photographs is None:
        app.recorder.say(WITHOUT)
        return
    at = PHOTOGRAPHS.index(app.scene.settings.photograph)
    show_photograph(app, PHOTOGRAPHS[(at + 1) % len(PHOTOGRAPHS)])
    app.recorder.say(f"photograph: {app.scene.settings.photograph}")


PHOTO_ACTIONS = {
    "next_photograph": _jump(1),
    "previous_photograph": _jump(-1),
    "place_photograph": _place,
}


def _places(app):
    from ..camera import places

    controls, where = app.controls, app.scene.settings.photograph
    return places(controls.size, app.covered(), controls.ratio, where)


def _look_from(app, photograph, places):
    from ..camera import seen_from

    scene, size = app.scene, app.controls.size
    scene.orbit = seen_from(photograph, scene.orbit, size, places.half_size, scene.center)


def placed_photograph(app):
    """The photograph that is to be drawn, or None, and its Places; one beside covers the view.

    One over the render is drawn as long as the camera is where it was taken.
    """
    photograph = None if app.photographs is None else app.photographs.shown
    where = app.scene.settings.photograph
    if photograph is None or where == "hidden":
        return None, None
    from ..camera import is_seen_from

    places = _places(app)
    if is_seen_from(photograph, app.scene.orbit):
        _look_from(app, photograph, places)  # the window or a panel may have another size
    elif where == "over":
        return None, None
    app.controls.covered = places.covered
    return photograph, places
