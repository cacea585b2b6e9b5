"""A pyglet window with an OpenGL 3.3 context, on the screen or without any display."""

GL_MAJOR, GL_MINOR = 3, 3


class WindowError(OSError):
    """No window can be opened; the message is one sentence for the user."""


def open_window(size: tuple[int, int], headless: bool, title: str = "deformrf"):
    """Open a window (an offscreen surface if headless) and make its context current.

    Returns:
        The pyglet window and the moderngl context.

    Raises:
        WindowError: There is no display, or no OpenGL 3.3.
    """
    import pyglet

    pyglet.options.headless = headless
    pyglet.options.dpi_scaling = "stretch"  # sizes in points, crisp on any screen
    pyglet.options.shadow_window = False  # moderngl binds to one context
    pyglet.options.debug_gl = False  # or errors are raised later, at calls that did not cause them
    try:
        import moderngl
        import pyglet.window

        config = pyglet.gl.Config(
            major_version=GL_MAJOR, minor_version=GL_MINOR, double_buffer=True, depth_size=24
        )
        window = pyglet.window.Window(
            *size, caption=title, resizable=True, vsync=True, config=config, file_drops=True
        )
        context = moderngl.create_context(require=100 * GL_MAJOR + 10 * GL_MINOR)
    except Exception as error:  # each platform and driver raises its own kinds
        if type(error).__name__ == "NoSuchDisplayException":
            raise WindowError(
                "there is no display to open a window on; with --headless the same program "
                "renders into files"
            ) from error
        place = "without a display" if headless else "on this display"
        raise WindowError(
            f"OpenGL {GL_MAJOR}.{GL_MINOR} is not available {place} ({error})"
        ) from error
    return window, context
