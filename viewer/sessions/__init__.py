"""Session files: what was done, written, checked, played again, and kept meanwhile."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "session": [
            "KEY",
            "Session",
            "SessionError",
            "load_session",
            "save_session",
            "start_of",
        ],
        "belonging": ["Opened", "open_session"],
        "player": ["Patience", "Player", "play_patiently", "spoken"],
        "session_values": ["FARTHEST_POINT"],
        "autosave": ["Autosave", "autosave_folder", "left_behind"],
    },
)
