from .running import (
    FAILED as FAILED,
    INPUT_ERROR as INPUT_ERROR,
    INTERRUPTED as INTERRUPTED,
    asked_for_version as asked_for_version,
    complain as complain,
    interrupts_waiting as interrupts_waiting,
    require as require,
    run as run,
)
from .training import (
    TrainArguments as TrainArguments,
    prepare_training as prepare_training,
    train_command as train_command,
)
