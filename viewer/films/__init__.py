"""Films, takes, videos and pictures; render_command.main is deformrf-render."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "codecs": ["CODECS"],
        "film_job": ["FORMATS", "RATES", "SAMPLE_COUNTS", "SIZES"],
        "recorder": ["Recorder", "without_background"],
        "takes": ["Takes"],
    },
)
