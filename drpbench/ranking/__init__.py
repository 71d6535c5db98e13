"""Statistics, the leaderboard and its tables."""

from .board import Leaderboard as Leaderboard
from .board import LeaderboardError as LeaderboardError
from .board import build as build
from .board import load_dir as load_dir
from .statistics import wilson as wilson
from .tables import render_entry as render_entry
