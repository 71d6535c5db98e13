"""Episodes one can watch: MCAP files for Foxglove, and videos."""

from .episode import Recording as Recording
from .episode import RecordingError as RecordingError
from .episode import episode as episode
from .episode import traced as traced
from .mcap_file import write_mcap as write_mcap
from .motion import Motion as Motion
from .motion import motion as motion
from .recorder import Recorder as Recorder
from .replay import Replay as Replay
from .replay import Replayer as Replayer
