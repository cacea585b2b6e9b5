"""What a tool is: what the left button does in the view, from one event of the mouse to the next.

Controls hands each event to the tool in the hand.  Where a tool takes no hold of anything, the
drag is the camera's.  Pixels are the image's.
"""

from ..camera import camera_of, panned, turned


class Tool:
    """One tool.

    Attributes:
        name, title, word, icon: Its row of controls.KINDS_OF_TOOL.
        hint: What it does, for the status line.
        cross: Whether the mouse is shown as a cross.
        waits: Whether it waits until the mouse has moved farther than in a click.
        mode: What it does now; empty if it doesn't hold the mouse.
        told: What it has to say now, for a line over the view.
        busy: Whether it works something out, after which there is something new to see.
        gizmo: The Gizmo of what is chosen; None without one.
        held_drag: The Drag or BoneDrag in progress; None without one.
        region: Pixels of the corners of the box that is drawn, or of the lasso.
        undoes, redoes: What of its own, not yet the object's, its `undo` would take back, and its
            `redo` bring again; or empty.
    """

    name = title = word = icon = hint = mode = told = undoes = redoes = ""
    cross, waits, can_cancel, busy = True, False, True, False
    gizmo = held_drag = None
    region = ()

    def __init__(self, controls):
        """Take the Controls: the picture, where to tell things, and what the tool acts on."""
        self.view, self.scene = controls, controls.scene
        self.handles = self.scene.handles

    # -- the mouse -----------------------------------------------------------------------

    def hover(self, pixel) -> None:
        """The mouse moves, and no button is down."""

    def leave(self) -> None:
        """The mouse is over something else, or another tool is in the hand."""

    def press(self, pixel, modifiers: int) -> bool:
        """The button goes down; whether the tool takes the mouse."""
        return False

    def move(self, before, pixel) -> bool:
        """The mouse moves while the button is down; False leaves the drag to the camera."""
        return True

    def release(self, pixel, clicked: bool, modifiers: int) -> None:
        """The button goes up."""

    def click(self, pixel) -> None:
        """A click where the tool took no hold of anything."""

    def wheel(self, notches: float) -> bool:
        """The wheel turns; whether that is the tool's."""
        return False

    def enter(self) -> bool:
        """Enter is pressed, and no button is down; whether the tool takes it."""
        return False

    def cancel(self) -> None:
        """Give up what the button does: all is as it was before the press."""

    def end(self) -> None:
        """It no longer holds the mouse."""
        self.mode = ""


class CameraMove(Tool):
    """A drag that turns or moves the camera.  `mode` is "orbit" or "pan"."""

    can_cancel = False

    def move(self, before, pixel) -> bool:
        view, pans = self.view, self.mode == "pan"
        orbit, height = view.viewpoint.orbit, view.size[1]
        if pans:
            height *= view.camera.focal / camera_of(orbit, *view.size).focal
        view.viewpoint.orbit = (panned if pans else turned)(orbit, *(pixel - before), height)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        orbit = self.view.viewpoint.orbit
        self.view.log(self.mode, yaw=orbit.yaw, pitch=orbit.pitch, target=orbit.target)


class DragTool(Tool):
    """A tool that moves, turns and scales: by the mouse, by keys and by the gizmo.

    Attributes:
        drag: What the button does, a Drag or a BoneDrag; `held_drag` while it holds something.
        drag_place: Where what is dragged is: the point that the axes of the drag go through.  [3]
    """

    drag = drag_place = None

    @property
    def held_drag(self):
        return self.drag

    def has_before_gizmo(self, pixel) -> bool:
        """Whether something is there that comes before the gizmo: a red point, or a joint."""

    def take(self, kind: str) -> bool:
        """Take what is chosen, else what is under the mouse, where it was pressed; whether it can.

        A button is down on the gizmo, or none is.
        """

    def turn_into(self, kind: str) -> None:
        """Let the drag in progress move, turn or scale what is held."""

    def follow(self, pixel) -> None:
        """Send what is dragged to where the mouse is, or where a number says."""

    def finish(self) -> None:
        """End the drag in progress: what was dragged is let go where it is."""
