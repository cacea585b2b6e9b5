from .layout import (
    covered as covered,
    draw_panels as draw_panels,
    loading_window as loading_window,
    playing_window as playing_window,
    training_window as training_window,
)
