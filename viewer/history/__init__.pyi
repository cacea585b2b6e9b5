from .journal import (
    EDITS as EDITS,
    MAY_BE_INFINITE as MAY_BE_INFINITE,
    Event as Event,
    Journal as Journal,
    edit as edit,
)
from .undo import (
    begin_anew as begin_anew,
    is_nothing as is_nothing,
    restore as restore,
    state_of as state_of,
    unless_it_fails as unless_it_fails,
)
