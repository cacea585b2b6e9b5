"""Errors of data sets; each message is one sentence for the user."""


class DatasetError(ValueError):
    """The folder is not a data set that can be read."""


class NoSplitError(DatasetError):
    """The files list no images of a split."""


class NoImagesError(DatasetError):
    """The files list images of a split, and none of them exists."""
