from .codecs import CODECS as CODECS
from .film_job import (
    FORMATS as FORMATS,
    RATES as RATES,
    SAMPLE_COUNTS as SAMPLE_COUNTS,
    SIZES as SIZES,
)
from .recorder import Recorder as Recorder, without_background as without_background
from .takes import Takes as Takes
