"""Rollouts, metrics, result files, statistics and the leaderboard."""

from .doctor import examine as examine
from .journal import Journal as Journal
from .leaderboard import Leaderboard as Leaderboard
from .leaderboard import LeaderboardError as LeaderboardError
from .leaderboard import build as build
from .leaderboard import load_dir as load_dir
from .results import Header as Header
from .results import Result as Result
from .results import ResultsError as ResultsError
from .results import Row as Row
from .results import load as load
from .results import save as save
from .rollout import LANES as LANES
from .rollout import Rollout as Rollout
from .run import Request as Request
from .run import run as run
from .statistics import wilson as wilson
from .tables import render_entry as render_entry
