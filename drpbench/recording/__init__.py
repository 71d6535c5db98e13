"""Episodes one can watch: MCAP files for Foxglove (`recorder`, `mcap_file`), and videos.

What writes MCAP files is imported from its own module, for it needs the extra `record`.
"""

from .episode import Recording as Recording
from .episode import RecordingError as RecordingError
from .episode import episode as episode
from .episode import traced as traced
from .motion import Motion as Motion
from .motion import motion as motion
from .replay import Replay as Replay
from .replay import Replayer as Replayer
